"""Where simulation and recordings differ, before and after what was found, in windows of trials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.mismatch import located, quantities, wording
from analysis.mismatch.candidates import Candidate
from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.joint import JointFit
from analysis.mismatch.located import Residual, residual_of
from analysis.mismatch.look import Look, strict
from analysis.mismatch.profiles import OUTSIDE
from analysis.mismatch.report import Window
from analysis.mismatch.signatures import accumulate
from analysis.mismatch.signflip import flip_test


@dataclass(frozen=True)
class Explained:
    """One chosen mechanism: its place among the fit's additions (None: not among them) and its candidate."""

    candidate: Candidate
    place: int | None
    alternatives: tuple[str, ...]


def chosen_of(diagnosis: Diagnosis) -> list[Explained]:
    """Return the chosen mechanisms, the one with the largest held-out gain first."""
    names = [a.mechanism.name for a in diagnosis.improved.simulation.additions]
    found = [
        Explained(c, names.index(c.mechanism.name) if c.mechanism.name in names else None, other)
        for c, other in zip(diagnosis.named.chosen, diagnosis.alternatives, strict=True)
    ]
    return sorted(found, key=lambda e: -e.candidate.total_gain)


def smallest_p(look: Look, more: Sequence[float] = ()) -> float:
    """Return the p-value of a residual as a whole: the smallest of all that were tested together."""
    return float(min([1.0, *look.p_of.values(), float(look.bin_p.min()), *more]))


@dataclass(frozen=True)
class Places:
    """Where simulation and recordings differ, before and after, and how much energy there was."""

    before: tuple[Window, ...]
    after: tuple[Window, ...]
    total: float
    left: float


def locate(diagnosis: Diagnosis) -> Places:
    """Return the windows in which trials differ from the simulation, without and with what was found."""
    problem, named = diagnosis.problem, diagnosis.named
    before, after = residual_of(problem, diagnosis.baseline), residual_of(problem, diagnosis.improved)
    additions = diagnosis.improved.simulation.additions
    latent = {
        e.place: quantities.effect_of(problem, diagnosis.improved, e.place)
        for e in chosen_of(diagnosis)
        if e.place is not None and e.candidate.mechanism.form in ("oscillation", "event")
    }
    trials = problem.trials
    in_latent = sum(
        float(t.counts @ e**2) for effects in latent.values() for t, e in zip(trials, effects, strict=True)
    )
    total = before.total + in_latent / problem.white_mn**2
    first_p = named.first_look.bin_p
    if diagnosis.named.chosen and diagnosis.named.chosen[0].mechanism.form == "ramp":
        first_p = _bin_p_of(diagnosis, diagnosis.baseline)
    whole_p = smallest_p(named.first_look, [c.p_value for c in named.chosen])
    windows = located.force_windows(trials, before, first_p, total, whole_p=whole_p)
    for e in chosen_of(diagnosis):
        if e.place in latent:
            words = wording.latent_conditions(problem, additions[e.place], latent[e.place])
            windows += located.effect_windows(
                problem,
                diagnosis.baseline,
                latent[e.place],
                p_value=e.candidate.p_value,
                total=total,
                words=words,
            )
    if not windows and named.chosen:
        strongest = chosen_of(diagnosis)[0].candidate
        windows = _difference_windows(
            diagnosis, diagnosis.baseline, diagnosis.improved, strongest.p_value, total
        )
    if not windows and not named.first_look.quiet:
        windows = _unexplained(diagnosis, before)
    left: tuple[Window, ...] = ()
    if named.chosen:
        repeats_p = located.repeats_p_value(after, np.random.default_rng(0))
        left_p = smallest_p(named.last_look, [strict(repeats_p)])
        left = located.force_windows(
            trials, after, named.last_look.bin_p, total, whole_p=left_p, all_of_them=True
        )
    windows = tuple(sorted(windows, key=lambda w: -w.share_of_mismatch))
    return Places(windows, left, total, after.total)


def _bin_p_of(diagnosis: Diagnosis, fit: JointFit) -> np.ndarray:
    """Return the p-values (2, B) of a fit's bins, all of them tested together."""
    problem = diagnosis.problem
    scores = accumulate(problem.trials, problem.whiteners, fit, []).bin_scores
    test = flip_test(scores, np.zeros(scores.shape[1], dtype=bool), np.random.default_rng(0))
    return test.p_value.reshape(2, OUTSIDE)


def _difference_windows(
    diagnosis: Diagnosis, before: JointFit, after: JointFit, p_value: float, total: float
) -> tuple[Window, ...]:
    """Return the phases in which two fits differ: for what is too weak to stand out of any one bin."""
    problem = diagnosis.problem
    effects = [problem.residual(before, j) - problem.residual(after, j) for j in range(len(problem.trials))]
    return located.effect_windows(
        problem, before, effects, p_value=p_value, total=total, words="every depth", share=0.15
    )


def _unexplained(diagnosis: Diagnosis, before: Residual) -> tuple[Window, ...]:
    """Return the place of what is significant as a whole, though no window of it is."""
    problem, look = diagnosis.problem, diagnosis.named.first_look
    name = min(look.p_of, key=lambda n: look.p_of[n])
    p_value = float(look.p_of[name])
    considered = [c for step in diagnosis.named.considered[:1] for c in step]
    best = next((c for c in considered if c.mechanism.name == name), considered[0] if considered else None)
    if best is not None:
        return _difference_windows(diagnosis, diagnosis.baseline, best.fit, p_value, before.total)
    words = f"looks most like {wording.spoken(name)}"
    at_rest = [(t.in_phase("hold") | t.in_phase("dwell")) & t.fitted for t in problem.trials]
    # its size: what the residual at rest has beyond white noise
    energy = cells = samples = 0.0
    for j, (t, mask) in enumerate(zip(problem.trials, at_rest, strict=True)):
        r = problem.residual(diagnosis.baseline, j)
        energy += float(t.counts[mask] @ r[mask] ** 2)
        cells += float(mask.sum())
        samples += float(t.counts[mask].sum())
    size_mn = np.sqrt(max(energy - cells * problem.white_mn**2, 1e-6 * energy) / max(samples, 1.0))
    effects = [size_mn * mask for mask in at_rest]
    return located.effect_windows(
        problem, diagnosis.baseline, effects, p_value=p_value, total=before.total, words=words
    )
