"""The questions asked of every fitted trial: what could make its numbers wrong, each with a number."""

from __future__ import annotations

import numpy as np

from analysis.recordings.trial import FloatArray, Trial
from analysis.relaxation import signal_checks
from analysis.relaxation.contact import Contact
from analysis.relaxation.noise import NoiseSpectrum, estimate_covariance, neighbouring_noise
from analysis.relaxation.ramp_fit import RampSolution, solve_blocks
from analysis.relaxation.result import Check, TrialFit
from analysis.relaxation.step_fit import StepSolution, solve_hold
from analysis.relaxation.windows import CannotFitError, FitWindow

_WINDOW_LIMIT = 1.0  # per cent that t1 may move; real two-term data move by about 0.1
_WINDOW_SIGMAS = 5.0
_IDENTIFIABLE_LIMIT = 30.0  # per cent of standard error beyond which a time is not known
_MOST_PERCENT = 999.0  # beyond, a number says no more than "not at all"
_SLOW_LIMIT = 1.5
_SLOW_SIGMAS = 5.0
_LAW_LIMIT = 0.25  # half of what a sphere differs from a flat punch


def checks_of_ramp(
    trial: Trial, window: FitWindow, contact: Contact, found: RampSolution, row: TrialFit
) -> tuple[Check, ...]:
    """Return the checks of a ramp fit."""
    n_arms = len(found.times_s)
    errors = np.sqrt(np.maximum(np.diag(found.covariance), 0.0))
    log_errors = errors[n_arms + 2 : 2 * n_arms + 2]
    in_hold = found.residual_mn[window.hold_start :]
    return (
        _half_window_of_ramp(window, found),
        *_shared(trial, window, contact, in_hold, noise=found.noise, row=row, offset_mn=found.offset_mn),
        _identifiable(row, window, log_errors),
        _contact_not_seen(window, seen=found.contact_seen),
        _law_not_told(found),
    )


def checks_of_step(
    trial: Trial, window: FitWindow, contact: Contact, found: StepSolution, row: TrialFit
) -> tuple[Check, ...]:
    """Return the checks of a step fit."""
    n_terms = len(found.times_s)
    log_errors = np.sqrt(np.maximum(np.diag(found.covariance)[1 + n_terms :], 0.0))
    before = contact.force_before_mn if contact.seen else None
    return (
        _half_window_of_step(window, found),
        *_shared(
            trial, window, contact, found.residual_mn, noise=found.noise, row=row, offset_mn=before or 0.0
        ),
        _identifiable(row, window, log_errors),
        _offset(before, row),
    )


def checks_of_signals(trial: Trial, window: FitWindow) -> tuple[Check, ...]:
    """Return the checks that need no fit."""
    return (
        signal_checks.hold_not_constant(window),
        signal_checks.control_mode_changed(trial, window),
        signal_checks.saturation(trial, window),
        signal_checks.depth_missed(trial, window),
    )


def _shared(
    trial: Trial,
    window: FitWindow,
    contact: Contact,
    in_hold_mn: FloatArray,
    *,
    noise: NoiseSpectrum,
    row: TrialFit,
    offset_mn: float,
) -> tuple[Check, ...]:
    return (
        *row.checks,
        signal_checks.contact_lost(window, offset_mn),
        signal_checks.motion_artefact(window, in_hold_mn),
        signal_checks.ringing(window, in_hold_mn),
        signal_checks.drift(trial, window, contact, row.estimates["A0_mn"].value),
        _not_white(noise, in_hold_mn),
        _incomplete(trial, row),
    )


def _half_window_of_ramp(window: FitWindow, found: RampSolution) -> Check:
    half = found.blocks.until((window.hold_start + len(window.time_s)) // 2)
    contact = Contact(found.contact_mm, 0, found.offset_mn, seen=found.contact_seen)
    try:
        solution, _ = solve_blocks(
            half,
            window,
            contact,
            len(found.times_s),
            found.parameters,
            law=found.law,
            exponent_free=found.exponent_free,
        )
    except CannotFitError:
        return _window_check(np.nan, np.inf)
    n_arms = len(found.times_s)
    slowest = int(np.argmax(solution.parameters[:n_arms]))
    noise = found.doubted
    at = n_arms + 2 + slowest
    before = estimate_covariance(solution.jacobian, half.edges, noise)[at, at]
    after = estimate_covariance(found.jacobian, found.blocks.edges, noise)[n_arms + 2, n_arms + 2]
    moved = float(solution.parameters[slowest]) - float(np.log(found.times_s[0]))
    return _window_check(moved, _difference_error(float(before), float(after)))


def _half_window_of_step(window: FitWindow, found: StepSolution) -> Check:
    half = found.blocks.until((len(window.time_s) - window.hold_start) // 2)
    try:
        solution = solve_hold(half, window, len(found.times_s), found.parameters)
    except CannotFitError:
        return _window_check(np.nan, np.inf)
    slowest = int(np.argmax(solution.parameters))
    noise, first = neighbouring_noise(found.residual_mn), 1 + len(found.times_s)
    before = estimate_covariance(solution.jacobian, half.edges, noise)[first + slowest, first + slowest]
    after = estimate_covariance(found.jacobian, found.blocks.edges, noise)[first, first]
    moved = float(solution.parameters[slowest]) - float(np.log(found.times_s[0]))
    return _window_check(moved, _difference_error(float(before), float(after)))


def _difference_error(half_variance: float, variance: float) -> float:
    """Standard error of an estimate's move when data are left away (Hausman): the variances' difference."""
    return float(np.sqrt(max(half_variance - variance, 0.04 * half_variance, 0.0)))


def _window_check(moved: float, error: float) -> Check:
    percent = 100.0 * float(np.expm1(np.clip(moved, -20.0, 20.0)))
    limit = max(_WINDOW_LIMIT, 100.0 * _WINDOW_SIGMAS * error)
    raised = bool(np.isfinite(percent) and abs(percent) > limit)
    text = f"t1 moves by {percent:.2g} % when the hold is halved (limit {limit:.2g} %)"
    return Check("window_unstable", percent, limit, "%", raised, text)


def _identifiable(row: TrialFit, window: FitWindow, log_errors: FloatArray) -> Check:
    """Ask whether this hold tells both times: their errors, the hold's length, their amplitudes."""
    percent = 100.0 * float(np.max(log_errors))
    faults = []
    if percent > _IDENTIFIABLE_LIMIT:
        faults.append("a time is known to no better than its standard error")
    t1, t2 = row.estimates["t1_s"].value, row.estimates["t2_s"].value
    if t1 > window.hold_s:
        faults.append(f"t1 = {t1:.3g} s is longer than the hold of {window.hold_s:.3g} s")
    if t2 < 3.0 * window.step_s:
        faults.append(f"t2 = {t2:.3g} s is not longer than three samples")
    if t1 < 1.5 * t2:
        faults.append(f"t1 and t2 are too close to tell apart ({t1:.3g} and {t2:.3g} s)")
    percent = min(percent, _MOST_PERCENT)
    for name in ("A1_over_A0", "A2_over_A0"):
        estimate = row.estimates[name]
        if estimate.value < 2.0 * estimate.se:
            faults.append(f"{name} = {estimate.value:.3g} is no more than its error of {estimate.se:.2g}")
    text = "; ".join(faults) if faults else "both times are told by this hold"
    return Check("times_not_identifiable", percent, _IDENTIFIABLE_LIMIT, "%", bool(faults), text)


def _not_white(noise: NoiseSpectrum, in_hold_mn: FloatArray) -> Check:
    if np.isfinite(noise.slow_ratio_se):
        limit = max(_SLOW_LIMIT, 1.0 + _SLOW_SIGMAS * noise.slow_ratio_se)
        ratio = noise.slow_ratio
        text = f"slow means of the residual vary {ratio:.3g} times as much as white noise would"
        return Check("residual_not_white", ratio, limit, "x", ratio > limit, text)
    centred = in_hold_mn - in_hold_mn.mean()
    power = float(centred @ centred)
    neighbour = float(centred[1:] @ centred[:-1]) / power if power > 0 else 0.0
    limit = 4.0 / float(np.sqrt(len(centred)))
    text = f"neighbouring residuals correlate by {neighbour:.3g}"
    return Check("residual_not_white", neighbour, limit, "", neighbour > limit, text)


def _contact_not_seen(window: FitWindow, *, seen: bool) -> Check:
    force_mn = float(np.median(window.force_mn[: max(1, min(20, window.hold_start))]))
    text = "contact was made within the recording"
    if not seen:
        text = f"recorded from {force_mn:.3g} mN on: depth counts from the first sample, k0 has no preload"
    return Check("contact_not_seen", force_mn, 0.0, "mN", not seen, text)


def _law_not_told(found: RampSolution) -> Check:
    """Ask whether the loading tells a flat punch from a sphere, where it was asked."""
    error = found.exponent.se if found.exponent is not None else 0.0
    text = f"the loading tells the exponent of the contact law to {error:.2g}"
    if not error < _LAW_LIMIT:
        text = "the loading does not tell a flat punch from a sphere or a cone: say it by --exponent"
    return Check("contact_law_not_told", min(error, 9.0), _LAW_LIMIT, "", not error < _LAW_LIMIT, text)


def _offset(before_mn: float | None, row: TrialFit) -> Check:
    limit = 0.02 * row.estimates["A0_mn"].value
    value = before_mn if before_mn is not None else 0.0
    text = f"force before contact is {value:.3g} mN, and A0 of the step fit contains it"
    return Check("force_offset", value, limit, "mN", abs(value) > limit, text)


def _incomplete(trial: Trial, row: TrialFit) -> Check:
    planned_s, got_s = trial.protocol.hold_s, row.hold_s or 0.0
    share = 100.0 * got_s / planned_s if planned_s else 100.0
    raised = trial.status not in ("complete", "recovered") or share < 95.0
    text = f"{share:.3g} % of the planned hold was recorded; the trial is {trial.status}"
    return Check("incomplete", share, 95.0, "%", raised, text)
