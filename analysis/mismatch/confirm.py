"""Held-out trials and held-out conditions: shared parameters frozen from training, then compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.joint import JointFit, fit_jointly
from analysis.mismatch.problem import Problem
from analysis.mismatch.signflip import FLIPS

FloatArray = NDArray[np.float64]

FOLDS = 5


@dataclass(frozen=True)
class HeldOut:
    """Mean squares of full-rate residuals of held-out trials (T,), mN^2, before and after; ``n_free`` (T,) latents."""

    scheme: str
    trials: tuple[int, ...]
    baseline_ms: FloatArray
    improved_ms: FloatArray
    p_value: float


def held_out(
    problem: Problem, baseline: JointFit, improved: JointFit, rng: np.random.Generator
) -> tuple[HeldOut, HeldOut | None]:
    """Return the comparison on held-out trials, and on a held-out condition where there is more than one."""
    n = len(problem.trials)
    if n < 3:
        everything = tuple(range(n))
        before, after = (
            _mean_squares(problem, baseline, everything),
            _mean_squares(problem, improved, everything),
        )
        return HeldOut("none held out: too few trials", everything, before, after, 1.0), None
    folds = [np.arange(k, n, min(FOLDS, n)) for k in range(min(FOLDS, n))]
    before, after = np.zeros(n), np.zeros(n)
    for fold in folds:
        before[fold] = _predict(problem, baseline, fold)
        after[fold] = _predict(problem, improved, fold)
    by_trial = HeldOut(
        f"{len(folds)} folds of whole trials; shared parameters from the other folds",
        tuple(range(n)),
        before,
        after,
        _flip_p(before - after, rng),
    )
    conditions = sorted({t.condition for t in problem.trials})
    if len(conditions) < 2:
        return by_trial, None
    depth = {c: np.mean([t.depth_mm for t in problem.trials if t.condition == c]) for c in conditions}
    middle = sorted(conditions, key=lambda c: float(depth[c]))[len(conditions) // 2]
    out = np.array([j for j, t in enumerate(problem.trials) if t.condition == middle])
    b, a = _predict(problem, baseline, out), _predict(problem, improved, out)
    by_condition = HeldOut(
        f"all trials of '{middle}' held out", tuple(out.tolist()), b, a, _flip_p(b - a, rng)
    )
    return by_trial, by_condition


def _predict(problem: Problem, fit: JointFit, out: NDArray[np.int64]) -> FloatArray:
    """Train on the other trials, freeze, refit only what belongs to each held-out trial; return mean squares."""
    inside = [j for j in range(len(problem.trials)) if j not in set(out.tolist())]
    train = _part(problem, inside)
    trained = train.fit(fit.simulation, [fit.own[j] for j in inside], rounds=4)
    test = _part(problem, out.tolist())
    frozen = fit_jointly(
        test.trials, test.whiteners, trained.simulation, [fit.own[j] for j in out], rounds=4, frozen=True
    )
    return _mean_squares(test, frozen, range(len(out)))


def _part(problem: Problem, index: Sequence[int]) -> Problem:
    return replace(
        problem,
        trials=tuple(problem.trials[j] for j in index),
        whiteners=tuple(problem.whiteners[j] for j in index),
    )


def _mean_squares(problem: Problem, fit: JointFit, index: Sequence[int]) -> FloatArray:
    """Return the mean square of the full-rate residual, charged for each trial's own free coefficients."""
    out = []
    for j in index:
        r = problem.full_residual(fit, j)
        out.append(float(r @ r) / max(len(r) - len(fit.latents[j]) - 2, 1))
    return np.array(out)


def _flip_p(gain: FloatArray, rng: np.random.Generator) -> float:
    signs = rng.integers(0, 2, size=(FLIPS, len(gain))) * 2.0 - 1.0
    return float((1 + np.sum(signs @ gain >= gain.sum() - 1e-15)) / (FLIPS + 1))
