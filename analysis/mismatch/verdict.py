"""From a diagnosis to a report: verdict, windows, mechanisms, what may hide, and how sure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.mismatch import located, quantities, wording
from analysis.mismatch.confirm import HeldOut
from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.look import LEVEL
from analysis.mismatch.places import Places, chosen_of, locate
from analysis.mismatch.remainder import (
    is_small,
    large_strays,
    remainder_first,
    remainder_of,
    stray_windows,
)
from analysis.mismatch.report import (
    Comparison,
    FoundMechanism,
    NextExperiment,
    NotIdentifiable,
    Quantity,
    Remainder,
    Report,
    Verdict,
    Window,
)
from analysis.simulation.mechanism import library

BEGINS_IN_CONTACT = 0.02
TOLERANCE_BELOW = 0.1
SMALL_FORCE = 0.01
SERVO_EXPLAINS = 0.4
SERVO_KNOWN = 0.3


def servo_named(diagnosis: Diagnosis) -> bool:
    """Whether another servo is seen in the position channel, and explains most of what differs there.

    A servo whose frequency stays unknown explains nothing: the drive is no such servo.
    """
    position = diagnosis.position
    return (
        position is not None
        and position.p_value <= LEVEL
        and position.explained >= SERVO_EXPLAINS
        and position.standard_errors[0] < SERVO_KNOWN
    )


def make_report(
    diagnosis: Diagnosis,
    *,
    baseline: str,
    seed: int,
    tolerance_mn: float,
    next_experiment: NextExperiment | None = None,
) -> Report:
    """Put a diagnosis into the words and numbers of the report."""
    tolerance_mn, tolerated = _tolerance(diagnosis, tolerance_mn)
    places = locate(diagnosis)
    mechanisms = _mechanisms(diagnosis)
    remainder = remainder_of(places)
    verdict = _verdict(diagnosis, places, mechanisms, remainder, tolerance_mn)
    position = _position_windows(diagnosis)
    mismatch = () if verdict == "no_mismatch" else places.before + position + stray_windows(diagnosis)
    if verdict == "unknown" and mechanisms:
        mismatch = remainder_first(places, mismatch)
    before, after = (
        quantities.shared_quantities(diagnosis.problem, fit)[0]
        for fit in (diagnosis.baseline, diagnosis.improved)
    )
    heldout, explained = _compare(diagnosis, diagnosis.confirmed), _explained_share(diagnosis, places)
    report = Report(
        verdict=verdict,
        summary="",
        n_trials=len(diagnosis.problem.trials),
        sample_rate_hz=max(t.sample_rate_hz for t in diagnosis.problem.trials),
        baseline=baseline,
        mismatch=mismatch,
        mechanisms=mechanisms,
        not_identifiable=_not_identifiable(diagnosis),
        baseline_parameters=before,
        improved_parameters=after,
        heldout=heldout,
        heldout_condition=None
        if diagnosis.confirmed_condition is None
        else _compare(diagnosis, diagnosis.confirmed_condition),
        explained_share=explained,
        remainder=remainder if verdict in ("named", "one_of") else None,
        next_experiment=next_experiment,
        left_out=diagnosis.intake.left_out,
        notes=(
            *diagnosis.intake.notes,
            *_contact_notes(diagnosis),
            *_scatter_notes(diagnosis),
            *_size_notes(mechanisms),
            *_end_notes(mechanisms),
            *tolerated,
        ),
        tolerance_mn=tolerance_mn,
        seed=seed,
    )
    return replace(report, summary=wording.summary(report))


def _tolerance(diagnosis: Diagnosis, tolerance_mn: float) -> tuple[float, tuple[str, ...]]:
    """Return what a law may leave over: less than was asked for where whole recordings lie below that."""
    largest = max(float(np.ptp(t.force_mn)) for t in diagnosis.problem.trials)
    if tolerance_mn < TOLERANCE_BELOW * largest:
        return tolerance_mn, ()
    small = SMALL_FORCE * largest
    words = (
        f"The tolerance of {tolerance_mn:g} mN is no less than a tenth of the largest force "
        f"({wording.force(largest)}): a hundredth of that force is tolerated instead."
    )
    return small, (words,)


def _contact_notes(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return what rests on the trials beginning before contact, where they show no motion without force."""
    pairs = zip(diagnosis.problem.trials, diagnosis.improved.own, strict=True)
    at_once = sum(
        t.touches and o.z0_mm <= t.begins_mm + BEGINS_IN_CONTACT * abs(t.depth_mm) for t, o in pairs
    )
    if not at_once:
        return ()
    return (
        f"In {at_once} of {len(diagnosis.problem.trials)} trials the force changes from the first motion on. A trial "
        "begins before contact, so the force at its beginning is taken as zero; had the punch pressed already, that "
        "force would be a preload, and a pull on the way back none.",
    )


def _scatter_notes(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return by how much repeats differ, where that is more than noise."""
    scatter_mn = diagnosis.problem.scatter_mn
    if not scatter_mn:
        return ()
    return (
        f"Trials of one condition differ from each other by {wording.force(scatter_mn)} rms beyond their noise, as if "
        "each had a gain or a tissue a little of its own. Every trial was allowed such a deviation; what is said "
        "here lies beyond it.",
    )


def _size_notes(mechanisms: tuple[FoundMechanism, ...]) -> tuple[str, ...]:
    """Return what the uncertainties of sizes do not say."""
    if not any(m.parameters for m in mechanisms):
        return ()
    return (
        "Sizes are those of the library's laws: ± says how well these trials settle them, not how far the real effect "
        "departs from its law.",
    )


def _at_an_end(mechanisms: tuple[FoundMechanism, ...]) -> tuple[tuple[str, Quantity], ...]:
    """Return the laws whose size ended at a limit of its range, where a fit knows no uncertainty, and that size."""
    sizes = ((m.name, m.parameters.get(library()[m.name].amplitude)) for m in mechanisms)
    return tuple((n, q) for n, q in sizes if q is not None and q.se == 0.0 and library()[n].form == "law")


def _end_notes(mechanisms: tuple[FoundMechanism, ...]) -> tuple[str, ...]:
    """Return which laws went as far as they can."""
    return tuple(
        f"{wording.spoken(name).capitalize()} ended at the limit of its range ({wording.with_error(q)}): a law that "
        "has to go so far is not the right one."
        for name, q in _at_an_end(mechanisms)
    )


def _position_windows(diagnosis: Diagnosis) -> tuple[Window, ...]:
    position = diagnosis.position
    if position is None:
        return ()
    bins = position.unknown_bins
    if servo_named(diagnosis) and not len(bins):
        bins = np.flatnonzero(position.bin_p <= LEVEL)
        if not len(bins):
            bins = np.array([int(np.argmax(np.abs(position.profile_mm)))])
    return located.position_windows(diagnosis.problem.trials, position, bins)


def _verdict(
    diagnosis: Diagnosis,
    places: Places,
    mechanisms: tuple[FoundMechanism, ...],
    remainder: Remainder | None,
    tolerance_mn: float,
) -> Verdict:
    position = diagnosis.position
    lever_unknown = position is not None and len(position.unknown_bins) > 0 and not servo_named(diagnosis)
    too_much = remainder is not None and not is_small(remainder, tolerance_mn)
    force_unknown = not diagnosis.named.chosen and not diagnosis.named.first_look.quiet
    if lever_unknown or too_much or force_unknown or large_strays(diagnosis) or _at_an_end(mechanisms):
        return "unknown"
    if not mechanisms:
        return "no_mismatch"
    return "one_of" if any(m.alternatives for m in mechanisms) else "named"


def _mechanisms(diagnosis: Diagnosis) -> tuple[FoundMechanism, ...]:
    problem, fit = diagnosis.problem, diagnosis.improved
    _, of_additions = quantities.shared_quantities(problem, fit)
    chosen = chosen_of(diagnosis)
    gains = sum(max(e.candidate.total_gain, 0.0) for e in chosen)
    found = []
    for e in chosen:
        m = e.candidate.mechanism
        found_quantities: dict[str, Quantity] = {}
        if e.place is not None and m.form == "law":
            found_quantities = of_additions[e.place]
        elif e.place is not None and m.form in ("oscillation", "event"):
            found_quantities = quantities.latent_quantities(problem, fit, e.place)
        found.append(
            FoundMechanism(
                name=m.name,
                stage=m.stage,
                alternatives=e.alternatives,
                p_value=float(e.candidate.p_value),
                parameters=found_quantities,
                explanation=wording.explanation(m, found_quantities, e.alternatives),
                share_of_mismatch=max(e.candidate.total_gain, 0.0) / max(gains, 1e-12),
            )
        )
    if servo_named(diagnosis) and diagnosis.position is not None:
        m = library()[quantities.SERVO]
        servo = quantities.servo_quantities(diagnosis)
        words, p_value = wording.explanation(m, servo, ()), diagnosis.position.p_value
        found.append(FoundMechanism(m.name, m.stage, (), p_value, servo, words, diagnosis.position.explained))
    return tuple(found)


def _not_identifiable(diagnosis: Diagnosis) -> tuple[NotIdentifiable, ...]:
    listed = {name for others in diagnosis.alternatives for name in others}
    return tuple(
        NotIdentifiable(a.mechanism.name, wording.hidden(a), a.mechanism.separated_by)
        for a in diagnosis.absorbed
        if a.mechanism.name not in listed
    )


def noise_floor_mn(diagnosis: Diagnosis) -> float:
    """Return the noise (mN rms a sample) measured from repeats: what is left, less what of it repeats.

    Never below half of the white noise that neighbouring samples show: of a single trial all of it repeats.
    """
    problem, fit = diagnosis.problem, diagnosis.improved
    total, samples = 0.0, 0.0
    for j in range(len(problem.trials)):
        r = problem.full_residual(fit, j)
        total += float(r @ r) * len(r) / max(len(r) - len(fit.latents[j]) - 2, 1)
        samples += len(r)
    repeats = max(float(problem.repeatable(fit).sum()), 0.0) * problem.white_mn**2
    return float(np.sqrt(max((total - repeats) / samples, 0.25 * problem.white_mn**2)))


def _compare(diagnosis: Diagnosis, held: HeldOut) -> Comparison:
    floor = noise_floor_mn(diagnosis)
    before = float(np.mean(held.baseline_ms))
    # nothing was added: both are the same simulation, and their figures are the same figures
    after = float(np.mean(held.improved_ms)) if diagnosis.named.chosen else before
    return Comparison(
        scheme=held.scheme,
        n_trials=len(held.trials),
        noise_floor_mn=floor,
        baseline_rms_mn=float(np.sqrt(before)),
        improved_rms_mn=float(np.sqrt(after)),
        baseline_chi2=before / floor**2,
        improved_chi2=after / floor**2,
        p_value=float(held.p_value) if diagnosis.named.chosen else 1.0,
    )


def _explained_share(diagnosis: Diagnosis, places: Places) -> float:
    """Return what share of the mismatch is explained.

    Of what never repeats, from held-out errors above the floor.
    """
    if not diagnosis.named.chosen:
        return 0.0
    if all(c.mechanism.form in ("law", "ramp") for c in diagnosis.named.chosen):
        share = 1.0 - places.left / max(places.total, 1e-12)
    else:
        floor2 = noise_floor_mn(diagnosis) ** 2
        before = float(np.mean(diagnosis.confirmed.baseline_ms))
        after = float(np.mean(diagnosis.confirmed.improved_ms))
        share = 1.0 - (after - floor2) / max(before - floor2, 1e-12)
    return float(np.clip(share, 0.0, 1.0))
