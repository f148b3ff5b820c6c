"""One trial's own parameters fitted at given laws: Levenberg-Marquardt on the whitened residual and its prior."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.fit.own import OwnColumns, force_columns, moved, own_columns
from analysis.mismatch.fit.whitener import Whitener
from analysis.mismatch.model.effects import Shared, TrialState, simulate
from analysis.mismatch.model.population import Population
from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]

ROUNDS = 25
DONE = 1e-3
SLOW = 0.05
"""A step that gains less of the cost than this is near enough for the old columns."""
LARGEST_LOG_STEP = 0.5
LARGEST_SHARE_OF_DEPTH = 0.1


def penalty(state: TrialState, population: Population) -> float:
    """Return the chi2 of a trial's own parameters against their priors."""
    cost = sum(float(c) ** 2 / s.prior for c, s in zip(state.coefficients, state.shapes, strict=True))
    if state.has_tissue:
        d = state.log_tissue - population.mean
        cost += float(d @ population.precision @ d)
    return cost


def fit_trial(
    trial: CellTrial,
    whitener: Whitener,
    state: TrialState,
    shared: Shared,
    population: Population,
    rounds: int = ROUNDS,
    own: OwnColumns | None = None,
) -> TrialState:
    """Return the most probable own parameters of a trial.

    Its columns are computed anew only where steps by the old ones no longer help (the chord method); ``own`` are
    columns that were computed near this state.
    """

    def cost_of(s: TrialState) -> tuple[float, FloatArray]:
        r = whitener(trial.force_mn - simulate(trial, s, shared))
        return float(r @ r) + penalty(s, population), r

    now, residual = cost_of(state)
    damping, old = 1e-6, own is not None
    for _ in range(rounds):
        if own is None:
            own = own_columns(force_columns(trial, state, shared), whitener, state, population)
            old = False
        step = _step(trial, own, residual, own.pull_at(state, population), damping)
        tried = moved(state, trial, step)
        new, new_residual = cost_of(tried)
        gained = now - new
        if gained > 0.0:
            state, now, residual = tried, new, new_residual
            if gained < DONE:
                return state
            if gained < SLOW * now or old:
                old = True
                continue
            own, damping = None, max(damping / 10.0, 1e-9)
        elif old:
            own = None
        elif gained > -DONE:
            return state
        else:
            damping = max(damping, 1e-5) * 10.0
            if damping > 1e6:
                return state
    return state


def _step(
    trial: CellTrial, own: OwnColumns, residual: FloatArray, pull: FloatArray, damping: float
) -> FloatArray:
    """Return a damped Gauss-Newton step (q,), no longer than a law stays smooth."""
    H = own.information
    damped = H + damping * np.diag(np.maximum(np.diag(H), 1e-12))
    return limited(trial, own, np.linalg.solve(damped, own.columns.T @ residual + pull))


def limited(trial: CellTrial, own: OwnColumns, step: NDArray[np.floating[Any]]) -> FloatArray:
    """Return a step (q,) cut to where columns still hold."""
    cut: FloatArray = np.array(step, dtype=np.float64)
    cut[own.tissue] = np.clip(cut[own.tissue], -LARGEST_LOG_STEP, LARGEST_LOG_STEP)
    if trial.touches:
        z = 1 if trial.frees_offset else 0
        largest = LARGEST_SHARE_OF_DEPTH * max(abs(trial.depth_mm), 1e-6)
        cut[z] = np.clip(cut[z], -largest, largest)
    return cut
