"""Where a trial's rhythms have moved its surface, and what they do to its force in a line about that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.fit.whitener import Whitener, surprise_of
from analysis.mismatch.model.effects import Acts, Shared, TrialState, own_effects, simulate
from analysis.mismatch.model.rhythm import Rhythm, waves
from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]

STEP = 1e-3
"""Of a rhythm's size: of a finite difference."""
FOLLOWED, HALVED = 8, 5
"""How often a surface is followed at most, and how often a step towards it is halved."""
DONE = 0.5
"""Chi2 that following it further must gain."""


def with_rhythm(trial: CellTrial, state: TrialState, shared: Shared, rhythm: Rhythm) -> TrialState:
    """Return the state with one more rhythm, of which nothing is known yet."""
    rhythm = replace(rhythm, waves=waves(trial, rhythm.frequency_hz))
    force_mn = _force_mn(trial, state, shared, rhythm)
    there = replace(
        rhythm,
        force_mn=force_mn,
        amplitudes=np.zeros_like(force_mn),
        found_mm=np.zeros(len(trial.time_s)),
        bent_mn=np.zeros(len(trial.time_s)),
    )
    return replace(state, rhythms=(*state.rhythms, there))


def followed(
    trial: CellTrial, state: TrialState, shared: Shared, whitener: Whitener
) -> tuple[TrialState, Whitener]:
    """Return the state with its rhythms where they are most probable, in a line about that, and what weighs it so.

    Gauss-Newton steps, halved until they gain: where skin is touched and left a surface's force is no line.
    """
    if not state.rhythms:
        return state, whitener
    now = _cost(trial, state, shared, whitener)
    for _ in range(FOLLOWED):
        likeliest = whitener.amplitudes(trial.force_mn - simulate(trial, state, shared))
        for halved in range(HALVED):
            there = _moved(state, likeliest, 0.5**halved)
            new = _cost(trial, there, shared, whitener)
            if new < now:
                break
        if not new < now:
            break
        columns = [_force_mn(trial, there, shared, r) for r in there.rhythms]
        found = (replace(r, force_mn=f) for r, f in zip(there.rhythms, columns, strict=True))
        state = _bent(trial, replace(there, rhythms=tuple(found)), shared)
        whitener = whitener.with_rhythms(state.rhythms)
        gained, now = now - new, new
        if gained < DONE:
            break
    return state, whitener


def _moved(state: TrialState, likeliest: Sequence[FloatArray], share: float) -> TrialState:
    """Return the state with its rhythms moved a share of the way to amplitudes (n, K) of each."""
    moved = []
    for rhythm, there in zip(state.rhythms, likeliest, strict=True):
        amplitudes = rhythm.amplitudes + share * (there - rhythm.amplitudes)
        surface_mm = np.sum(rhythm.size_mm * rhythm.waves * amplitudes, axis=1)
        moved.append(replace(rhythm, amplitudes=amplitudes, found_mm=surface_mm))
    return replace(state, rhythms=tuple(moved))


def _cost(trial: CellTrial, state: TrialState, shared: Shared, whitener: Whitener) -> float:
    """Return the chi2 of a trial with its rhythms as they were found, and theirs of what they are beforehand."""
    left = whitener.with_rhythms(())(
        trial.force_mn - simulate(trial, state, shared, where_found(trial, state))
    )
    return float(left @ left) + sum(surprise_of(trial, r) for r in state.rhythms)


def where_found(trial: CellTrial, state: TrialState) -> dict[Acts, FloatArray]:
    """Return what a trial's own shapes come to, the surface where its rhythms were found."""
    own = own_effects(replace(state, rhythms=()))
    surface_mm = own.get("surface", np.zeros_like(trial.time_s))
    return {**own, "surface": surface_mm + sum(r.found_mm for r in state.rhythms)}


def _bent(trial: CellTrial, state: TrialState, shared: Shared) -> TrialState:
    """Return the state with what the surface where each rhythm was found makes of the force beyond the rhythm's line.

    Of several each is beside those before it.
    """
    before_mn = simulate(trial, replace(state, rhythms=()), shared)
    bent: list[Rhythm] = []
    for rhythm in state.rhythms:
        beside = replace(state, rhythms=(*bent, rhythm))
        force_mn = simulate(trial, state, shared, where_found(trial, beside))
        bent.append(replace(rhythm, bent_mn=force_mn - before_mn - rhythm.passed_mn))
        before_mn = force_mn
    return replace(state, rhythms=tuple(bent))


def _force_mn(trial: CellTrial, state: TrialState, shared: Shared, rhythm: Rhythm) -> FloatArray:
    """Return the change of force (n, K) by each wave of a rhythm times its size, mN."""
    own = where_found(trial, state)
    base = simulate(trial, state, shared, own)
    surface_mm = own["surface"] + STEP * rhythm.size_mm * rhythm.waves.T
    there_mn = simulate(trial, state, shared, {**own, "surface": surface_mm})
    return np.ascontiguousarray((there_mn - base).T / STEP)
