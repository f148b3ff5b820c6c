"""From a diagnosis to a report: verdict, windows, mechanisms, what may hide, and how sure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.gram import solve
from analysis.mismatch.levels import SMALL_SHARE, TOLERANCE_SHARE
from analysis.mismatch.locate.remainder import is_small
from analysis.mismatch.model.effects import TISSUE_NAMES, TISSUE_SIZE
from analysis.mismatch.name.finding import Finding
from analysis.mismatch.name.own_sizes import SIZE_INEXACT, Quantity
from analysis.mismatch.report import amounts, wording
from analysis.mismatch.report.contents import (
    Comparison,
    FoundMechanism,
    NotIdentifiable,
    Remainder,
    Report,
    Verdict,
)
from analysis.mismatch.report.windows import MOST_WINDOWS, force_windows, position_windows, servo_named
from analysis.simulation.mechanism import library

SERVO = "servo_bandwidth"
TOLERANCE_BELOW = 0.1
BEGINS_IN_CONTACT = 0.02
SMALLEST_SHARE = 0.005
"""Share of the mismatch below which a window is not worth a row."""


def make_report(diagnosis: Diagnosis, *, baseline: str, seed: int, tolerance_mn: float) -> Report:
    """Put a diagnosis into the words and numbers of the report."""
    tolerance_mn, tolerated = _tolerance(diagnosis, tolerance_mn)
    diagnosis = replace(diagnosis, remainder=diagnosis.remainder.beyond(tolerance_mn))
    kept = kept_findings(diagnosis)
    improved = diagnosis.improved if kept else diagnosis.baseline
    mechanisms = _mechanisms(diagnosis, kept)
    remainder = _remainder(diagnosis)
    verdict = _verdict(diagnosis, mechanisms, remainder, tolerance_mn)
    located = diagnosis.located or diagnosis.left
    mismatch = () if verdict == "no_mismatch" else (*force_windows(located), *position_windows(diagnosis))
    if verdict == "unknown" and mechanisms:
        mismatch = (*force_windows(diagnosis.left, after_naming=True), *mismatch)[:MOST_WINDOWS]
    mismatch = tuple(w for w in mismatch if w.share_of_mismatch >= SMALLEST_SHARE)
    report = Report(
        verdict=verdict,
        summary="",
        n_trials=len(diagnosis.intake.trials),
        sample_rate_hz=max(t.sample_rate_hz for t in diagnosis.intake.trials),
        baseline=baseline,
        mismatch=mismatch,
        mechanisms=mechanisms,
        not_identifiable=_not_identifiable(diagnosis, mechanisms),
        baseline_parameters=tissue_quantities(diagnosis.baseline),
        improved_parameters=tissue_quantities(improved),
        heldout=_comparison(diagnosis, named=bool(kept)),
        explained_share=_explained_share(diagnosis) if mechanisms else 0.0,
        remainder=remainder if verdict in ("named", "one_of") else None,
        next_experiment=None,
        left_out=diagnosis.intake.left_out,
        notes=(
            *diagnosis.intake.notes,
            *_notes(diagnosis, mechanisms),
            *_nameless_note(diagnosis),
            *tolerated,
        ),
        tolerance_mn=tolerance_mn,
        seed=seed,
        peak_force_mn=max(float(np.ptp(t.force_mn)) for t in diagnosis.intake.trials),
        setting=diagnosis.intake.setting,
        imports=diagnosis.intake.imports,
    )
    return with_summary(report, diagnosis)


def with_summary(report: Report, diagnosis: Diagnosis) -> Report:
    """Return the report with its summary written anew from what it holds by now."""
    return replace(report, summary=wording.summary(report, _nameless_words(diagnosis)))


def _nameless_note(diagnosis: Diagnosis) -> tuple[str, ...]:
    nameless, words = diagnosis.nameless, _nameless_words(diagnosis)
    if not nameless.share:
        return ()
    return (
        f"Something that no mechanism of the library names explains {amounts.percent(nameless.share)} of what differed "
        f"and changes the force by {amounts.force(nameless.rms_mn)} rms{words and ': '}{words}.",
    )


def _nameless_words(diagnosis: Diagnosis) -> str:
    """Return the words for a law that was found and has no name in the library, if there is one."""
    mechanisms = (law.mechanism for law in diagnosis.improved.fit.shared.laws)
    return next((m.words for m in mechanisms if m.name not in library()), "")


def kept_findings(diagnosis: Diagnosis) -> tuple[Finding, ...]:
    """Return the findings that stand: not at a bound, and together right to a third at least.

    Where more than a tenth is left, or explained only by laws that are granted to be off, they are the nearest laws to
    something else, and their names would mislead.
    """
    if max(_left(diagnosis), diagnosis.remainder.inexact) > SMALL_SHARE:
        return ()
    return tuple(f for f in diagnosis.findings if not f.at_bound)


def _left(diagnosis: Diagnosis) -> float:
    """Return what share of the evidence for any mismatch is left: what has no name explains nothing."""
    left = diagnosis.remainder.share if diagnosis.remainder.significant else 0.0
    return min(left + diagnosis.nameless.share, 1.0)


def _verdict(
    diagnosis: Diagnosis,
    mechanisms: Sequence[FoundMechanism],
    remainder: Remainder | None,
    tolerance_mn: float,
) -> Verdict:
    position = diagnosis.position
    lever_unknown = position is not None and len(position.unknown_bins) > 0 and not servo_named(diagnosis)
    if (
        diagnosis.remainder.significant
        and remainder
        and not is_small(remainder.share, remainder.rms_mn, tolerance_mn)
    ):
        return "unknown"
    nameless = diagnosis.nameless
    if not is_small(nameless.share, nameless.rms_mn, tolerance_mn):
        return "unknown"
    if any(not line.name and line.rms_mn >= tolerance_mn for line in diagnosis.lines):
        return "unknown"
    if lever_unknown or (diagnosis.findings and not kept_findings(diagnosis)):
        return "unknown"
    if not mechanisms:
        return "no_mismatch"
    return "one_of" if any(m.alternatives for m in mechanisms) else "named"


def _tolerance(diagnosis: Diagnosis, tolerance_mn: float) -> tuple[float, tuple[str, ...]]:
    """Return what a law may leave over: less than was asked for where whole recordings lie below that."""
    largest = max(float(np.ptp(t.force_mn)) for t in diagnosis.intake.trials)
    if tolerance_mn < TOLERANCE_BELOW * largest:
        return tolerance_mn, ()
    small = TOLERANCE_SHARE * largest
    return small, (
        f"The tolerance of {tolerance_mn:g} mN is no less than a tenth of the largest force "
        f"({amounts.force(largest)}): a hundredth of that force is tolerated instead.",
    )


def _remainder(diagnosis: Diagnosis) -> Remainder | None:
    """Return what is significant after everything found: its share in all evidence, and the largest window's rms."""
    if not diagnosis.remainder.significant:
        return None
    where = force_windows(diagnosis.left)
    return Remainder(diagnosis.remainder.share, max((w.rms_mn or 0.0 for w in where), default=0.0), where)


def _mechanisms(diagnosis: Diagnosis, kept: Sequence[Finding]) -> tuple[FoundMechanism, ...]:
    total = max(sum(max(f.evidence, 0.0) for f in diagnosis.findings), 1e-12)
    found = [
        FoundMechanism(
            name=f.name,
            stage=f.mechanism.stage,
            alternatives=tuple(f.alternatives),
            p_value=f.p_value,
            parameters=f.parameters,
            explanation=wording.explanation(f.mechanism, f.parameters, tuple(f.alternatives)),
            share_of_mismatch=max(f.evidence, 0.0) / total,
            probability=f.probability,
            alternative_probabilities=dict(f.alternatives),
        )
        for f in kept
    ]
    position = diagnosis.position
    if position is not None and servo_named(diagnosis):
        m, drive = library()[SERVO], diagnosis.intake.servo
        # no drive is a second-order servo to more than any law is right; an output that steps would have had a part
        stepped = drive.steps_show * np.log(np.divide(drive.of_steps, drive.of_lines))
        se = np.sqrt(np.square(position.standard_errors) + SIZE_INEXACT**2 + stepped**2)
        wn, zeta = drive.of_lines
        servo = {
            "natural_frequency_rad_s": Quantity(wn, wn * float(se[0]), "rad/s"),
            "damping_ratio": Quantity(zeta, zeta * float(se[1]), "1"),
        }
        words = wording.explanation(m, servo, ())
        found.append(
            FoundMechanism(m.name, m.stage, (), position.p_value, servo, words, position.explained, 1.0, {})
        )
    return tuple(found)


def tissue_quantities(account: Account) -> Mapping[str, Quantity]:
    """Return the population's mean constants; their errors hold how trials scatter. tau1 is the longer time."""
    fit = account.fit
    if not any(s.has_tissue for s in fit.states):
        return {}
    N, ridge = account.grams.total(), account.grams.ridge
    errors = np.sqrt(np.diag(solve(N, ridge, range(TISSUE_SIZE + account.grams.n_added))[1])[:TISSUE_SIZE])
    values = np.exp(fit.population.mean)
    order = [0, 1, 2, 3, 4] if values[2] >= values[4] else [0, 3, 4, 1, 2]
    units = ("mN/mm", "mN/mm", "s", "mN/mm", "s")
    return {
        name: Quantity(float(values[k]), float(values[k] * errors[k]), unit)
        for name, k, unit in zip(TISSUE_NAMES, order, units, strict=True)
    }


def _not_identifiable(
    diagnosis: Diagnosis, mechanisms: Sequence[FoundMechanism]
) -> tuple[NotIdentifiable, ...]:
    listed = {name for m in mechanisms for name in m.alternatives}
    return tuple(
        NotIdentifiable(a.mechanism.name, wording.hidden(a), a.mechanism.separated_by)
        for a in diagnosis.absorbed
        if a.mechanism.name not in listed
    )


def _comparison(diagnosis: Diagnosis, *, named: bool) -> Comparison:
    held = diagnosis.confirmed
    # a tone that was taken out beforehand had been in the baseline's error
    tones = sum(0.5 * line.amplitude_mn**2 for line in diagnosis.lines)
    before = float(np.mean(held.baseline_ms)) + tones
    after = float(np.mean(held.improved_ms)) if named else before
    floor2 = held.floor_mn**2
    return Comparison(
        scheme=held.scheme,
        n_trials=len(held.baseline_ms),
        noise_floor_mn=held.floor_mn,
        baseline_rms_mn=float(np.sqrt(before)),
        improved_rms_mn=float(np.sqrt(after)),
        baseline_chi2=before / floor2,
        improved_chi2=after / floor2,
        p_value=held.p_value if named else 1.0,
    )


def _explained_share(diagnosis: Diagnosis) -> float:
    """Return what share of the evidence for any mismatch is explained, mean of the channels in which there is one."""
    left = _left(diagnosis)
    shares = [1.0 - left] if diagnosis.findings or left else []
    position = diagnosis.position
    if position is not None and (servo_named(diagnosis) or len(position.unknown_bins)):
        shares.append(min(position.explained, 1.0) if servo_named(diagnosis) else 0.0)
    return float(np.mean(shares)) if shares else 0.0


def _notes(diagnosis: Diagnosis, mechanisms: Sequence[FoundMechanism]) -> tuple[str, ...]:
    """Return what a reader must know beside the figures."""
    fit, notes = diagnosis.improved.fit, []
    at_once = sum(
        t.touches and s.z0_mm <= t.begins_mm + BEGINS_IN_CONTACT * abs(t.depth_mm)
        for t, s in zip(fit.trials, fit.states, strict=True)
    )
    if at_once:
        notes.append(
            f"In {at_once} of {len(fit.trials)} trials the force changes from the first motion on. A trial begins "
            "before contact, so the force at its beginning is taken as zero; had the punch pressed already, that "
            "force would be a preload, and a pull on the way back none."
        )
    if sum(s.has_tissue for s in fit.states) > 1:
        scatter = 100.0 * np.sqrt(np.diag(fit.population.covariance))
        notes.append(
            "Every trial has a tissue of its own; they scatter by "
            + ", ".join(
                f"{s:.2g} % ({amounts.symbol(n)})" for n, s in zip(TISSUE_NAMES, scatter, strict=True)
            )
            + ". The constants given are their means."
        )
    if any(m.parameters for m in mechanisms):
        notes.append(
            "Sizes are those of the library's laws: ± holds how well these trials settle them, and that a law is right "
            "to about a tenth."
        )
    if diagnosis.findings and _left(diagnosis) > SMALL_SHARE:
        nearest = " and ".join(amounts.symbol(f.name) for f in diagnosis.findings)
        notes.append(
            f"Nearest to what differed came {nearest}, which would explain "
            f"{amounts.percent(1.0 - _left(diagnosis))} of it: too little to be its name."
        )
    notes += [
        f"{amounts.symbol(f.name).capitalize()} ended at the limit of its range, or of what a law may be off by: one "
        "that has to go so far is not the right one."
        for f in diagnosis.findings
        if f.at_bound
    ]
    notes += [*wording.tones(diagnosis.lines, fit.noise), *wording.louder(fit.trials)]
    rate_hz = min(t.sample_rate_hz for t in diagnosis.intake.trials)
    return (*wording.late(diagnosis.position, rate_hz), *notes)
