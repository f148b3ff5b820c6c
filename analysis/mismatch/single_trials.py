"""The search where nothing repeats: one or two trials, in which a large effect bends everything else that is fitted.

With one trial the first law's misfit is the next one's evidence, and the order of naming decides what is named. So
several orders are followed side by side, and the simulation that leaves least is kept.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.candidates import REFITTED, Candidate, best_refit, candidates
from analysis.mismatch.joint import JointFit
from analysis.mismatch.look import LEVEL, Look, look
from analysis.mismatch.problem import Problem
from analysis.mismatch.search import MOST_MECHANISMS, SINGLE_TRIAL_SHARE, Named
from analysis.mismatch.signatures import block_edges
from analysis.mismatch.signflip import flip_test

FloatArray = NDArray[np.float64]

FOLLOWED = 3
PROMISING = 0.2


@dataclass(frozen=True)
class _Path:
    """Mechanisms named in one order: fits from the baseline on, and what was considered beside each."""

    fits: tuple[JointFit, ...]
    chosen: tuple[Candidate, ...]
    considered: tuple[tuple[Candidate, ...], ...]

    @property
    def cost(self) -> float:
        return float(self.fits[-1].cost.sum())

    @property
    def names(self) -> frozenset[str]:
        return frozenset(c.mechanism.name for c in self.chosen)


def search_few(problem: Problem, baseline: JointFit, rng: np.random.Generator) -> Named:
    """Add mechanisms along several orders side by side; keep the simulation that leaves least.

    A mechanism counts if it takes a hundredth of what was explained, and more blocks of the trials agree with it than
    chance allows.
    """
    first = look(problem, baseline, rng)
    best = _Path((baseline,), (), ())
    paths = [best]
    while paths and len(best.chosen) < MOST_MECHANISMS and not first.quiet:
        grown: dict[frozenset[str], _Path] = {}
        for path in paths:
            seen = first if not path.chosen else look(problem, path.fits[-1], rng)
            found = _found(problem, path.fits[-1], seen, rng)
            for c in found:
                longer = _Path((*path.fits, c.fit), (*path.chosen, c), (*path.considered, tuple(found)))
                known = grown.get(longer.names)
                if known is None or longer.cost < known.cost:
                    grown[longer.names] = longer
        paths = sorted(grown.values(), key=lambda p: p.cost)[:FOLLOWED]
        explained = float(baseline.cost.sum()) - (paths[0].cost if paths else best.cost)
        if not paths or best.cost - paths[0].cost <= SINGLE_TRIAL_SHARE * explained:
            break
        best = paths[0]
    considered = best.considered or ((),)
    return Named(best.fits, best.chosen, considered, first, look(problem, best.fits[-1], rng))


def _found(problem: Problem, fit: JointFit, seen: Look, rng: np.random.Generator) -> list[Candidate]:
    """Return what a fit improves by and blocks agree on, best first.

    Laws are judged after a refit: a large effect is far from where its signature was taken. They are judged by what
    they gain on all trials (Akaike's charge of 2 for a parameter taken off), since none of these repeats another, and
    a trial of a speed or depth of its own is not to be predicted from the others.
    """
    ranked = sorted(seen.best, key=lambda n: -seen.best[n][0][0])
    worth = PROMISING * seen.best[ranked[0]][0][0] if ranked else 0.0
    by_gain = [n for n in ranked if seen.best[n][0][0] >= worth or seen.p_of.get(n, 1.0) <= LEVEL]
    found = []
    for name in by_gain[:REFITTED]:
        refitted = best_refit(problem, fit, seen.best[name])
        mechanism = seen.best[name][0][1].mechanism
        charged = 2.0 * len(mechanism.parameters) / len(fit.cost)
        found.append(Candidate(mechanism, refitted, fit.cost - refitted.cost - charged, 1.0))
    named = {c.mechanism.name for c in found}
    found += [
        c
        for c in candidates(problem, fit, seen)
        if c.mechanism.form != "law" and c.mechanism.name not in named
    ]
    judged = [
        replace(c, p_value=_block_p(problem, fit, c.fit, rng)) if c.mechanism.form == "law" else c
        for c in found
    ]
    kept = [c for c in judged if c.total_gain > 0 and c.p_value <= LEVEL]
    return sorted(kept, key=lambda c: -c.total_gain)


def _block_p(problem: Problem, before: JointFit, after: JointFit, rng: np.random.Generator) -> float:
    """Return the p-value of a gain by the signs of what blocks of the trials gain."""
    gains = []
    for j, trial in enumerate(problem.trials):
        gain = problem.weighed_residual(before, j) ** 2 - problem.weighed_residual(after, j) ** 2
        edges = block_edges(trial.phase[trial.fitted])
        gains.append(np.add.reduceat(gain, edges[:-1]))
    scores = np.concatenate(gains)[:, None]
    return float(flip_test(scores, np.ones(1, dtype=bool), rng).p_value[0])
