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
DONE = 5e-3
"""Chi2 that a step must gain, by noise as large as what is left, as of laws."""
SLOW = 0.05
"""A step that gains less of the cost than this is near enough for the old columns."""
LARGEST_LOG_STEP = 0.5
LARGEST_DAMPING = 1e6
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
    own: OwnColumns,
    rounds: int = ROUNDS,
    *,
    near: bool = False,
) -> tuple[TrialState, float]:
    """Return the most probable own parameters of a trial, and the cost there.

    ``own`` are its columns at this state, or ``near`` it. They are kept while steps by them gain little (the chord
    method), and computed anew where one gains much, as none does near the best, or nothing.
    """

    def cost_of(s: TrialState) -> tuple[float, FloatArray]:
        # a step too far may end where no force is a number any more: it costs infinitely much
        with np.errstate(over="ignore", invalid="ignore"):
            r = whitener(trial.force_mn - simulate(trial, s, shared))
            cost = float(r @ r) + penalty(s, population)
        return (cost if np.isfinite(cost) else np.inf), r

    if near:
        now, residual = cost_of(state)
    else:
        residual = own.residual
        now = float(residual @ residual) + penalty(state, population)
    if now == np.inf:
        return state, now
    damping, old = 1e-6, near
    for _ in range(rounds):
        done = DONE * max(now / len(residual), 1.0)
        gradient = own.columns.T @ residual + own.pull_at(state, population)
        H = own.information
        damped = H + damping * np.diag(np.maximum(np.diag(H), 1e-12))
        step = bounded(damped, gradient, room_below(trial, state, own, population))
        if float(step @ gradient) < done:
            break
        tried = moved(state, trial, limited(trial, state, own, step))
        new, new_residual = cost_of(tried)
        gained = now - new
        if gained > 0.0:
            state, now, residual = tried, new, new_residual
            if gained < done:
                break
            if gained < SLOW * now:
                old = True
                continue
            damping = max(damping / 10.0, 1e-9)
        elif not old:
            if gained > -done or damping > LARGEST_DAMPING:
                break
            damping = max(damping, 1e-5) * 10.0
            continue
        own, old = own_columns(force_columns(trial, state, shared), whitener, state, population), False
    return state, now


def room_below(trial: CellTrial, state: TrialState, own: OwnColumns, population: Population) -> FloatArray:
    """Return how far down (q,) own parameters may go: a contact's approach and a tissue's arms have an end."""
    room = np.full(own.n_own, -np.inf)
    if trial.touches:
        room[int(trial.frees_offset)] = trial.highest_contact_mm - state.z0_mm
    if state.has_tissue:
        room[own.tissue] = population.lowest - state.log_tissue
    return room


def bounded(H: FloatArray, gradient: FloatArray, room: FloatArray) -> FloatArray:
    """Return x (q,) of H x = gradient; what would fall below its room stays there, the others follow it."""
    x = np.asarray(np.linalg.solve(H, gradient), dtype=np.float64)
    fixed = x < room
    while np.any(x < room):
        fixed |= x < room
        x = np.where(fixed, room, 0.0)
        free = ~fixed
        x[free] = np.linalg.solve(
            H[np.ix_(free, free)], gradient[free] - H[np.ix_(free, fixed)] @ room[fixed]
        )
    return x


def limited(
    trial: CellTrial, state: TrialState, own: OwnColumns, step: NDArray[np.floating[Any]]
) -> FloatArray:
    """Return a step (q,) cut to where columns still hold."""
    cut: FloatArray = np.array(step, dtype=np.float64)
    logarithms = [
        *range(own.tissue.start, own.tissue.stop),
        *(own.tissue.stop + k for k in state.shapes.law_values.values()),
    ]
    cut[logarithms] = np.clip(cut[logarithms], -LARGEST_LOG_STEP, LARGEST_LOG_STEP)
    if trial.touches:
        z = 1 if trial.frees_offset else 0
        largest = LARGEST_SHARE_OF_DEPTH * max(abs(trial.depth_mm), 1e-6)
        cut[z] = np.clip(cut[z], -largest, largest)
    return cut
