"""One trial, one row: the fit by either model, its estimates, its checks, or the reason why there is none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis.recordings.trial import FloatArray, Trial
from analysis.relaxation import signal_checks
from analysis.relaxation.constants import StepAnswer
from analysis.relaxation.contact import Contact, find_contact
from analysis.relaxation.contact_law import FLAT, ContactLaw
from analysis.relaxation.creep import fit_creep
from analysis.relaxation.quality import checks_of_ramp, checks_of_signals, checks_of_step
from analysis.relaxation.ramp_fit import RampSolution, fit_ramp
from analysis.relaxation.result import Amplitudes, Estimate, Model, TrialFit
from analysis.relaxation.step_fit import StepSolution, fit_step
from analysis.relaxation.told import check_elastic, without_untold
from analysis.relaxation.windows import CannotFitError, FitWindow, cut_creep, cut_window


def fit_trial(trial: Trial, model: Model = "ramp", exponent: float | None = None) -> TrialFit:
    """Fit one trial. Never raises: a trial that can't be fitted comes back with the reason in ``failure``.

    ``exponent`` p of the contact law d^p (1 flat punch, 1.5 sphere, 2 cone) holds it there; without one the
    ramp model asks the loading for it. The step model needs none.
    """
    labels = TrialFit(
        file=Path(trial.path).name,
        trial_id=trial.trial_id,
        model=model,
        finger=trial.specimen.finger,
        subject=trial.specimen.subject,
        depth_mm=trial.protocol.depth_mm,
        repeat=trial.specimen.repeat,
        discarded=trial.discarded,
        log=trial.log if trial.source == "imported" else (),
    )
    try:
        with np.errstate(all="ignore"):
            creeping = cut_creep(trial) if model == "ramp" else None
            if creeping is not None:
                labels = _creep_labels(labels, trial, creeping)
                return _creep_row(labels, creeping, exponent)
            window = cut_window(trial)
            labels = _measured_labels(labels, window, model)
            # a trial that is refused keeps what its signals say of the reason
            labels = replace(labels, checks=checks_of_signals(trial, window))
            contact = find_contact(window)
            if model == "step":
                return _step_row(labels, trial, window, contact)
            return _ramp_row(labels, trial, window, contact, exponent)
    except CannotFitError as reason:
        return replace(labels, failure=str(reason))
    except (ArithmeticError, ValueError, IndexError, MemoryError) as fault:
        # whatever a hopeless recording does to the arithmetic: its row says so, the study goes on
        return replace(labels, failure=f"the arithmetic failed ({type(fault).__name__}: {fault})")


def _measured_labels(labels: TrialFit, window: FitWindow, model: Model) -> TrialFit:
    held_mm = window.position_mm[window.hold_start :]
    hold_mm = float(np.median(held_mm[:: max(1, len(held_mm) // 1000)]))
    travel_mm = hold_mm - float(np.median(_before(window.position_mm, window.ramp_start)))
    used = len(window.time_s) - (window.hold_start if model == "step" else 0)
    before_mn = float(np.median(_before(window.force_mn, min(window.ramp_start, 20))))
    cells = max(1, round(0.01 / window.step_s))
    means_mn = np.add.reduceat(window.force_mn, np.arange(0, len(window.force_mn), cells))[:-1] / cells
    peak_mn = float(np.max(means_mn)) - before_mn if len(means_mn) else 0.0
    return replace(
        labels,
        depth_mm=labels.depth_mm if labels.depth_mm is not None else travel_mm,
        n_samples=used,
        ramp_s=window.ramp_s,
        hold_s=window.hold_s,
        peak_mn=peak_mn if peak_mn > 0 else None,
    )


def _before(values: FloatArray, index: int) -> FloatArray:
    return values[max(0, index - 200) : index + 1] if index > 200 else values[: index + 1][-1:]


def _ramp_row(
    labels: TrialFit, trial: Trial, window: FitWindow, contact: Contact, exponent: float | None
) -> TrialFit:
    found = fit_ramp(window, contact=contact, exponent=exponent)
    k0, n_arms = float(found.stiffness_mn_per_mm[0]), len(found.times_s)
    share = k0 / float(np.sum(found.stiffness_mn_per_mm))
    check_elastic(share, window, None if share > 0.01 else _elastic_of_hold(window))
    hold_mm = float(np.mean(found.blocks.position_mm[found.blocks.edges >= window.hold_start]))
    indentation_mm = hold_mm - found.contact_mm
    depth_mm = np.array([max(indentation_mm, 0.0)])
    # columns of the covariance: k0, k1.., offset, log t1.., contact, exponent
    a0, level_mm = np.zeros(len(found.covariance)), float(found.law.level(depth_mm)[0])
    a0[0] = level_mm
    if found.contact_seen:
        a0[2 * n_arms + 2] = -k0 * float(found.law.slope(depth_mm)[0])
    if found.exponent_free:
        a0[-1] = k0 * float(found.law.exponent_slope(depth_mm)[0])
    estimates = {"A0_mn": Estimate(k0 * level_mm, _spread(a0, found.covariance))}
    for i in range(n_arms):
        ratio = float(found.stiffness_mn_per_mm[1 + i]) / k0
        by = np.zeros(len(found.covariance))
        by[0], by[1 + i] = -ratio / k0, 1.0 / k0
        estimates[f"A{i + 1}_over_A0"] = Estimate(ratio, _spread(by, found.covariance))
    for i, tau_s in enumerate(found.times_s):
        by = np.zeros(len(found.covariance))
        by[n_arms + 2 + i] = tau_s
        estimates[f"t{i + 1}_s"] = Estimate(float(tau_s), _spread(by, found.covariance))
    errors = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    names = ("k0_mn_per_mm", *(f"k{i + 1}_mn_per_mm" for i in range(n_arms)), "offset_mn")
    names = (*names, *(f"log_t{i + 1}" for i in range(n_arms)))
    solid = Amplitudes(
        stiffness_mn_per_mm=tuple(found.stiffness_mn_per_mm.tolist()),
        times_s=tuple(found.times_s.tolist()),
        contact_mm=found.contact_mm,
        contact_se_mm=float(errors[2 * n_arms + 2]) if found.contact_seen else 0.0,
        contact_seen=found.contact_seen,
        offset_mn=found.offset_mn,
        offset_se_mn=float(errors[n_arms + 1]),
        indentation_mm=indentation_mm,
        parameters=(
            *names,
            *(["contact_mm"] if found.contact_seen else []),
            *(["exponent"] if found.exponent_free else []),
        ),
        covariance=found.covariance,
        exponent=found.law.exponent,
        reference_mm=found.law.reference_mm,
    )
    rms_mn, r2 = _goodness(window, found)
    row = replace(
        labels,
        estimates=estimates,
        exponent=found.exponent,
        stiffness_mn_per_um=k0 * level_mm / indentation_mm / 1000.0 if indentation_mm > 0 else None,
        rms_mn=rms_mn,
        r2=r2,
        solid=solid,
    )
    row = replace(row, checks=checks_of_ramp(trial, window, contact, found, row))
    return _accepted(row, found.times_s, errors[n_arms + 2 : 2 * n_arms + 2], found.time_at_bound)


def _step_row(labels: TrialFit, trial: Trial, window: FitWindow, contact: Contact) -> TrialFit:
    found = fit_step(window)
    a0, n_terms = float(found.amplitudes_mn[0]), len(found.times_s)
    check_elastic(a0 / float(np.sum(found.amplitudes_mn)), window, None)
    estimates = {"A0_mn": Estimate(a0, float(np.sqrt(max(found.covariance[0, 0], 0.0))))}
    for i in range(n_terms):
        ratio = float(found.amplitudes_mn[1 + i]) / a0
        by = np.zeros(len(found.covariance))
        by[0], by[1 + i] = -ratio / a0, 1.0 / a0
        estimates[f"A{i + 1}_over_A0"] = Estimate(ratio, _spread(by, found.covariance))
    for i, tau_s in enumerate(found.times_s):
        by = np.zeros(len(found.covariance))
        by[1 + n_terms + i] = tau_s
        estimates[f"t{i + 1}_s"] = Estimate(float(tau_s), _spread(by, found.covariance))
    depth_mm = labels.depth_mm
    stiffness = a0 / (1000.0 * depth_mm) if depth_mm is not None and depth_mm > 0 else None
    rms_mn, r2 = _goodness(window, found)
    answer = StepAnswer(a0, tuple(zip(found.amplitudes_mn[1:].tolist(), found.times_s.tolist(), strict=True)))
    row = replace(
        labels, estimates=estimates, stiffness_mn_per_um=stiffness, rms_mn=rms_mn, r2=r2, step_answer=answer
    )
    row = replace(row, checks=checks_of_step(trial, window, contact, found, row))
    log_errors = np.sqrt(np.maximum(np.diag(found.covariance)[1 + n_terms :], 0.0))
    return _accepted(row, found.times_s, log_errors, found.time_at_bound)


def _creep_labels(labels: TrialFit, trial: Trial, window: FitWindow) -> TrialFit:
    message = next(event.message for event in trial.events if event.kind == "force_held")
    checks = (signal_checks.saturation(trial, window), signal_checks.depth_missed(trial, window))
    return replace(_measured_labels(labels, window, "ramp"), creep=message, checks=checks)


def _creep_row(labels: TrialFit, window: FitWindow, exponent: float | None) -> TrialFit:
    """Return the row of a pause in which force was held: the same solid, from its creep."""
    contact = find_contact(window, exponent or 1.0)
    if not contact.seen:
        raise CannotFitError("the recording begins in contact: a creep needs the force from its beginning")
    reach_mm = float(np.max(window.position_mm)) - contact.position_mm
    law = ContactLaw(exponent, max(reach_mm, 1e-12)) if exponent is not None else FLAT
    found = fit_creep(window, contact, law)
    k0, n = float(found.stiffness_mn_per_mm[0]), len(found.times_s)
    level_mm = float(law.level(np.array([max(found.depth_mm, 0.0)]))[0])
    by_k0 = np.zeros(len(found.covariance))
    by_k0[0] = level_mm
    estimates = {"A0_mn": Estimate(k0 * level_mm, _spread(by_k0, found.covariance))}
    for i, tau_s in enumerate(found.times_s.tolist()):
        ratio = float(found.stiffness_mn_per_mm[1 + i]) / k0
        by, by_time = np.zeros(len(found.covariance)), np.zeros(len(found.covariance))
        by[0], by[1 + i], by_time[1 + n + i] = -ratio / k0, 1.0 / k0, tau_s
        estimates[f"A{i + 1}_over_A0"] = Estimate(ratio, _spread(by, found.covariance))
        estimates[f"t{i + 1}_s"] = Estimate(tau_s, _spread(by_time, found.covariance))
    position_mm = window.position_mm[-len(found.residual_mm) :]
    squares = float(np.mean(np.square(found.residual_mm)))
    row = replace(
        labels,
        estimates=estimates,
        stiffness_mn_per_um=k0 * level_mm / found.depth_mm / 1000.0 if found.depth_mm > 0 else None,
        rms_mn=float(np.sqrt(squares)) * k0,
        r2=1.0 - squares / float(np.var(position_mm)),
    )
    log_errors = np.sqrt(np.maximum(np.diag(found.covariance)[1 + n :], 0.0))
    return _accepted(row, found.times_s, log_errors, found.at_bound)


def _elastic_of_hold(window: FitWindow) -> Estimate | None:
    """Return A0 as the hold alone has it, mN; None where that is not told either."""
    try:
        found = fit_step(window)
    except (CannotFitError, ArithmeticError, ValueError):
        return None
    value, error = float(found.amplitudes_mn[0]), float(np.sqrt(max(found.covariance[0, 0], 0.0)))
    return Estimate(value, error) if 0 < 4.0 * error < value else None


def _spread(by: FloatArray, covariance: FloatArray) -> float:
    """Return the standard error of a quantity whose derivatives by the parameters are ``by``."""
    return float(np.sqrt(max(float(by @ covariance @ by), 0.0)))


def _goodness(window: FitWindow, found: RampSolution | StepSolution) -> tuple[float, float]:
    """Return the root mean square of the residual, mN, and R2."""
    residual_mn = found.residual_mn
    first = window.hold_start if isinstance(found, StepSolution) else 0
    force_mn = window.force_mn[first : first + len(residual_mn)]
    squares = float(np.sum(np.square(residual_mn)))  # no BLAS: its threads cost more than the sum
    centred = force_mn - force_mn.mean()
    total = float(np.sum(np.square(centred)))
    return float(np.sqrt(squares / len(residual_mn))), 1.0 - squares / total


def _accepted(
    row: TrialFit, times_s: FloatArray, log_errors: FloatArray, at_bound: tuple[bool, ...]
) -> TrialFit:
    if not np.all(np.isfinite([estimate.value for estimate in row.estimates.values()])):
        raise CannotFitError("the estimates are not finite numbers")
    return without_untold(row, times_s, log_errors, at_bound)
