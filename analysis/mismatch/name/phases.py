"""Phases and sizes of rhythms as they were found: what is tied to the trial, to another rhythm or to motion is none."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import KEPT
from analysis.mismatch.model.effects import touches
from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]


def phases_alike(fit: StudyFit, name: str) -> float:
    """Return how alike the phases of a rhythm are where holds begin, in nats.

    H0: the phase is uniform and independent in each trial, as nothing ties a body's rhythm to them.
    """
    turned = []
    for j, hz, surface_mm in _surfaces(fit, name):
        hold = fit.trials[j].in_phase("hold")
        if np.any(hold):
            turned.append(_turned(fit.trials[j], surface_mm, hold, hz, float(fit.trials[j].time_s[hold][0])))
    return _alike(turned)


def ahead_alike(fit: StudyFit, name: str, slower: str) -> float:
    """Return how alike a rhythm's phases are from trial to trial beside an overtone of a slower one, in nats.

    H0: how far it is ahead of that overtone is uniform and independent in each trial. As both wander it is told in
    cycles of the slower one, in holds. Nothing, where none of its overtones is near.
    """
    slow = {j: (hz, surface_mm) for j, hz, surface_mm in _surfaces(fit, slower)}
    ahead = []
    for j, hz, surface_mm in _surfaces(fit, name):
        trial = fit.trials[j]
        hold = trial.in_phase("hold")
        if j not in slow or not np.any(hold):
            continue
        slow_hz, slow_mm = slow[j]
        number = round(hz / slow_hz)
        if number < 2:
            return 0.0
        cycle = np.floor((trial.time_s - trial.time_s[hold][0]) * slow_hz)
        of_trial = 0.0j
        for k in np.unique(cycle[hold]):
            inside = hold & (cycle == k)
            middle_s = float(trial.time_s[inside].mean())
            beside = _turned(trial, slow_mm, inside, slow_hz, middle_s)
            if beside:
                turned = _turned(trial, surface_mm, inside, hz, middle_s)
                of_trial += turned * np.conj(beside / abs(beside)) ** number
        ahead.append(of_trial)
    return _alike(ahead)


def _turned(
    trial: CellTrial, surface_mm: FloatArray, inside: NDArray[np.bool_], hz: float, zero_s: float
) -> complex:
    """Return what a surface has of a frequency in some cells, its phase that at a time."""
    wave = np.exp(-2j * np.pi * hz * (trial.time_s[inside] - zero_s))
    return complex(np.sum(trial.widths_s[inside] * surface_mm[inside] * wave))


def _alike(turned: Sequence[complex]) -> float:
    """Return how alike phases are, in nats: n R^2 of Rayleigh's test.

    H0: they are uniform and independent in each of n trials. Then the mean resultant length R makes n R^2 exponential,
    of mean 1 (Mardia and Jupp, Directional Statistics, 2000, 6.3.1).
    """
    unit = np.array([z / abs(z) for z in turned if z])
    return float(np.abs(unit.sum()) ** 2 / len(unit)) if len(unit) else 0.0


def stops_at_rest(fit: StudyFit, name: str) -> bool:
    """Return whether a rhythm is less than half as large (rms) in holds as while the punch moves in contact.

    A body's goes on whatever the punch does. What a gear, a screw or a rough skin makes of the way comes with motion.
    """
    power = {"hold": 0.0, "motion": 0.0}
    length_s = dict.fromkeys(power, 0.0)
    for j, _, surface_mm in _surfaces(fit, name):
        trial = fit.trials[j]
        touching, hold = touches(trial, fit.states[j], fit.shared), trial.in_phase("hold")
        for when, cells in (("hold", hold & touching), ("motion", touching & ~hold)):
            power[when] += float(trial.widths_s[cells] @ surface_mm[cells] ** 2)
            length_s[when] += float(trial.widths_s[cells].sum())
    return power["hold"] * length_s["motion"] < KEPT**2 * power["motion"] * length_s["hold"]


def _surfaces(fit: StudyFit, name: str) -> Iterator[tuple[int, float, FloatArray]]:
    """Yield which trials have a rhythm, its frequency in Hz, and where it was found to have moved the surface, mm."""
    for j, state in enumerate(fit.states):
        moved = [
            (state.shapes[k].at, state.coefficients[k] * state.shapes[k].shape) for k in state.shapes.of(name)
        ]
        moved += [(r.frequency_hz, r.found_mm) for r in state.rhythms if r.effect == name]
        if moved:
            yield j, moved[0][0], np.sum([surface_mm for _, surface_mm in moved], axis=0)
