"""Least squares with linear amplitudes: they are projected out, only times and places are searched.

Variable projection with Kaufman's derivative (BIT 15, 49, 1975), damped after Levenberg and Marquardt.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import FloatArray
from analysis.relaxation.windows import CannotFitError

_MOST_STEPS = 80
_SETTLED = 1e-9  # relative change of the sum of squares
_NO_GAIN = 1e-11  # of the sum of squares; with 80,000 samples a step of a thousandth of a standard error
_NEAR_SETTLED_STEP = 1e-9


@dataclass(frozen=True, slots=True)
class Rows:
    """A model at given nonlinear parameters: ``rows`` (L, K) of unit amplitudes, and ``slopes``.

    ``slopes(amplitudes)`` (P, K) are the derivatives of amplitudes @ rows by the nonlinear parameters.
    """

    rows: FloatArray
    slopes: Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True)
class Solution:
    """The least-squares solution.

    ``amplitudes`` (L,), ``parameters`` (P,), ``squares`` the weighted sum of squares, ``jacobian`` (L + P, K)
    the unweighted derivatives of the model by amplitudes, then parameters. ``settled`` is False where the
    search ran out of steps; ``at_bound`` (P,) says which parameters stopped at a bound.
    """

    amplitudes: FloatArray
    parameters: FloatArray
    squares: float
    jacobian: FloatArray
    settled: bool
    at_bound: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class _State:
    squares: float
    amplitudes: FloatArray
    residual: FloatArray
    slopes: FloatArray
    jacobian: FloatArray


def solve_separable(
    model: Callable[[FloatArray], Rows],
    target: FloatArray,
    weights: FloatArray,
    *,
    start: FloatArray,
    low: FloatArray,
    high: FloatArray,
    n_springs: int,
) -> Solution:
    """Return the least-squares solution for ``target`` (K,) with ``weights`` (K,), from ``start`` (P,).

    ``low`` and ``high`` (P,) bound the nonlinear parameters. The first ``n_springs`` amplitudes are
    springs: where the best solution would have a negative one, the search is held to those that have
    none. Raises CannotFitError where the model has no finite value at the start.
    """
    roots, begin = np.sqrt(weights), np.clip(start, low, high)
    free = _search(model, target, roots, start=begin, low=low, high=high)
    if free is None:
        raise CannotFitError("the model has no finite value at the starting point")
    if np.all(free.amplitudes[:n_springs] >= 0):
        return free
    held = _search(
        model,
        target,
        np.sqrt(weights),
        start=np.clip(start, low, high),
        low=low,
        high=high,
        n_springs=n_springs,
    )
    if held is None:
        worst = float(np.min(free.amplitudes[:n_springs]) / np.max(np.abs(free.amplitudes[:n_springs])))
        raise CannotFitError(
            f"no springs and dashpots fit: the force does not fall as a solid's would, "
            f"a spring would be negative ({worst:.2g} of the largest)"
        )
    return held


def _search(
    model: Callable[[FloatArray], Rows],
    target: FloatArray,
    roots: FloatArray,
    *,
    start: FloatArray,
    low: FloatArray,
    high: FloatArray,
    n_springs: int = 0,
) -> Solution | None:
    """Return the solution near ``start``; None if one of ``n_springs`` amplitudes is negative there."""
    parameters = start
    state = _evaluate(model, target, roots, parameters, n_springs)
    if state is None:
        return None
    damping, settled = 1e-3, len(parameters) == 0
    for _ in range(_MOST_STEPS):
        if settled:
            break
        normal = state.slopes @ state.slopes.T
        gradient = state.slopes @ state.residual
        scale = np.maximum(np.diag(normal), 1e-300)
        step = np.linalg.solve(normal + damping * np.diag(scale), gradient)
        if damping < 1e-3 and step @ gradient <= _NO_GAIN * state.squares:
            settled = True  # what a step can still gain is far below what the noise tells
            break
        proposed = np.clip(parameters + step, low, high)
        trial = _evaluate(model, target, roots, proposed, n_springs)
        if trial is None or trial.squares > state.squares:
            damping *= 8.0
            settled = damping > 1e12 or bool(np.all(np.abs(proposed - parameters) < _NEAR_SETTLED_STEP))
            continue
        settled = state.squares - trial.squares <= _SETTLED * max(state.squares, 1e-300)
        parameters, state, damping = proposed, trial, max(damping / 10.0, 1e-9)
    return Solution(
        state.amplitudes,
        parameters,
        state.squares,
        state.jacobian,
        settled,
        (parameters <= low) | (parameters >= high),
    )


def _evaluate(
    model: Callable[[FloatArray], Rows],
    target: FloatArray,
    roots: FloatArray,
    parameters: FloatArray,
    n_springs: int,
) -> _State | None:
    """Return the state, None where it is not finite, amplitudes are undetermined or a spring is negative."""
    from scipy.linalg.lapack import dgeqrf, dorgqr, dtrtrs

    built = model(parameters)
    if not np.isfinite(built.rows.sum()):
        return None
    aim = target * roots
    factored, reflectors, _, _ = dgeqrf((built.rows * roots).T, overwrite_a=True)
    triangle = factored[: len(built.rows)].copy()
    diagonal = np.abs(triangle.diagonal())
    if len(aim) < len(triangle) or not diagonal.min() > 1e-13 * diagonal.max():
        return None
    orthogonal, _, _ = dorgqr(factored, reflectors, overwrite_a=True)
    shares = aim @ orthogonal
    amplitudes, _ = dtrtrs(triangle, shares)
    if np.any(amplitudes[:n_springs] < 0):
        return None
    residual = aim - orthogonal @ shares
    slopes = built.slopes(amplitudes)
    projected = slopes * roots
    projected -= (projected @ orthogonal) @ orthogonal.T
    squares = float(residual @ residual)
    if not np.isfinite(squares) or not np.isfinite(projected.sum()):
        return None
    return _State(squares, amplitudes, residual, projected, np.concatenate([built.rows, slopes]))
