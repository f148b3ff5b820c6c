"""Name what was left out: the best of the significant candidates is added, everything refitted, and again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.mismatch.candidates import Candidate, candidates
from analysis.mismatch.joint import JointFit
from analysis.mismatch.look import Look, look
from analysis.mismatch.problem import REPEATS, Problem
from analysis.mismatch.profiles import OUTSIDE
from analysis.mismatch.surface_oscillation import SurfaceOscillation, is_overtone

MOST_MECHANISMS = 4
SHARE_EXPLAINED = (0.35, 0.6, 0.8)
SMALL_SHARE = 0.10
SMALL_MUST_EXPLAIN = 0.80
MOST_TRIALS = 0.6
SMALLEST_SHARE = 0.002
SMALLEST_BESIDE_UNSTEADY = 1e-4
EXTRA_SHARE = 0.02
OVERTONE_SHARE = 0.1
REPEATED_SHARE = 0.5
SINGLE_TRIAL_SHARE = 0.01
CLEAR_OF_ERROR = 2.0
TRIED_TOGETHER = 2
SLACK = 2.0 * float(np.sqrt(2.0 * OUTSIDE))
"""By how much the repeatable energy scatters: two standard deviations over all bins, in units of chi2."""


@dataclass(frozen=True)
class Named:
    """What the search arrived at: fits from the baseline on, and what was considered at each step."""

    fits: tuple[JointFit, ...]
    chosen: tuple[Candidate, ...]
    considered: tuple[tuple[Candidate, ...], ...]
    first_look: Look
    last_look: Look


def search(problem: Problem, baseline: JointFit, rng: np.random.Generator) -> Named:
    """Add mechanisms while they are significant and explain enough of what repeats; at most four."""
    fits = [baseline]
    chosen: list[Candidate] = []
    considered: list[tuple[Candidate, ...]] = []
    first = seen = look(problem, baseline, rng)
    while len(chosen) < MOST_MECHANISMS:
        left = problem.weighed_repeatable(fits[-1])
        found = [c for c in candidates(problem, fits[-1], seen) if not repeats(problem, left, c)]
        considered.append(tuple(found))
        if not found:
            break
        best = next((c for c in found if _worth_naming(problem, left, c, chosen)), None)
        if best is None or best.total_gain < 0.5 * found[0].total_gain:
            pair = None if chosen else _worth_together(problem, left, found, rng)
            if pair is None:
                break
            first_of_pair, beside, best = pair
            chosen.append(first_of_pair)
            fits.append(first_of_pair.fit)
            considered.append(beside)
        chosen.append(best)
        fits.append(best.fit)
        seen = look(problem, best.fit, rng)
    return Named(tuple(fits), tuple(chosen), tuple(considered), first, seen)


def repeats(problem: Problem, left: float, candidate: Candidate) -> bool:
    """Tell whether most of what an oscillation explains is the same in every trial: its phase is not, a law's work is.

    A slow wave that may swell and fade as it likes follows what a quick relaxation leaves, too. ``left``: what
    repeats without it.
    """
    if candidate.mechanism.form != "oscillation" or len(problem.trials) < REPEATS:
        return False
    return left - problem.weighed_repeatable(candidate.fit) > REPEATED_SHARE * candidate.total_gain


def _worth_together(
    problem: Problem, left: float, found: Sequence[Candidate], rng: np.random.Generator
) -> tuple[Candidate, tuple[Candidate, ...], Candidate] | None:
    """Return two laws that explain little each but nearly all together, and what was considered beside the second.

    Two effects may hide each other: what a lag takes from a quick relaxation's force, the relaxation gives. Asked only
    before anything is named: beside a large effect two laws explain its remainder easily.
    """
    for first in [c for c in found if c.mechanism.form == "law"][:TRIED_TOGETHER]:
        beside = tuple(candidates(problem, first.fit, look(problem, first.fit, rng)))
        second = next((c for c in beside if c.mechanism.form == "law"), None)
        if second is None or second.total_gain < first.total_gain:
            continue
        if first.total_gain + second.total_gain + SLACK >= SMALL_MUST_EXPLAIN * max(left, 0.0):
            return first, beside, second
    return None


def _worth_naming(problem: Problem, left: float, best: Candidate, chosen: Sequence[Candidate]) -> bool:
    """Judge whether a mechanism explains enough of what is left to repeat, the more the smaller it is beside others.

    A rough law's remainder can look like a little of anything; only what takes most of it away earns a name. The
    more laws are there already, the more a further one has to explain: three that explain a third each of what is
    left are no physics but a fit. What an oscillation or an event leaves over differs from trial to trial as they
    do themselves: a law beside them repeats, and may be far smaller.
    """
    explained = sum(c.total_gain for c in chosen)
    by_laws = sum(c.total_gain for c in chosen if c.mechanism.form == "law")
    smallest = SMALLEST_SHARE * explained
    if best.mechanism.form == "law":
        smallest = max(SMALLEST_SHARE * by_laws, SMALLEST_BESIDE_UNSTEADY * explained)
    if best.total_gain < smallest:
        return False
    if len(problem.trials) < REPEATS:
        # what repeats can't be asked of one or two trials
        return best.total_gain > SINGLE_TRIAL_SHARE * explained
    left = max(left, 0.0)
    if best.mechanism.form == "oscillation":
        # an oscillation is in every trial, and does not repeat: what is in a few trials, or far less than what
        # repeats, is something else's remainder
        everywhere = float(np.mean(best.gain > 0)) >= MOST_TRIALS
        needed = (OVERTONE_SHARE if _overtone(best) else EXTRA_SHARE) * explained
        return everywhere and best.total_gain > needed and best.total_gain + SLACK > left
    if best.mechanism.form == "event":
        return best.total_gain > EXTRA_SHARE * explained
    share = best.total_gain / (explained + max(best.total_gain, left))
    laws = sum(c.mechanism.form == "law" for c in chosen)
    if explained and share <= SMALL_SHARE and not _measured(problem, best):
        return False
    needed = SHARE_EXPLAINED[min(laws, 2)] if share > SMALL_SHARE else SMALL_MUST_EXPLAIN
    return bool(best.total_gain + SLACK >= needed * left)


def _overtone(candidate: Candidate) -> bool:
    """Tell whether an oscillation may be an overtone of one that was named before: breath and pulse have several."""
    latents = [a.latent for a in candidate.fit.simulation.additions]
    waves = [latent for latent in latents if isinstance(latent, SurfaceOscillation)]
    return bool(waves) and is_overtone(waves[-1], waves[:-1])


def _measured(problem: Problem, candidate: Candidate) -> bool:
    """Tell whether a law's size stands clear of its standard error; where its scale has no zero, it does."""
    mechanism, trials = candidate.mechanism, problem.trials
    parameter = mechanism.parameter(mechanism.amplitude)
    if parameter.scale == "log":
        return True
    simulation = candidate.fit.simulation
    at = len(simulation.vector(trials)) - len(mechanism.parameters) + mechanism.parameters.index(parameter)
    size = simulation.vector(trials)[at] - parameter.to_fit(mechanism.null[mechanism.amplitude])
    return bool(abs(size) > CLEAR_OF_ERROR * np.sqrt(candidate.fit.covariance[at, at]))
