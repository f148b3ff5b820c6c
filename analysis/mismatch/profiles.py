"""Residuals of different trials laid over each other: bins that mean the same in every trial.

A bin is a stretch of a phase: of the time since it began (dwell, hold, clear), of the depth below the skin
(approach, retract), or of its course (ramp, sweep). What repeats over trials in a bin is mismatch; what does not is
noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import PHASE_NAMES
from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SINCE_START_S = np.array(
    [0.0, 0.0015, 0.004, 0.01, 0.025, 0.06, 0.15, 0.3, 0.6, 1.2, 2.5, 4.5, 8.0, 15.0, 30.0, 60.0]
)
DEPTH_MM = np.array(
    [-9.0, -0.3, -0.1, -0.04, -0.015, 0.0, 0.015, 0.03, 0.05, 0.08, 0.12, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0]
)
COURSE = np.linspace(0.0, 1.0, 13)
SWEEP_COURSE = np.linspace(0.0, 1.0, 41)


def _edges(phase: str) -> FloatArray:
    if phase in ("approach", "retract"):
        return DEPTH_MM
    if phase == "sweep":
        return SWEEP_COURSE
    return COURSE if phase == "ramp" else SINCE_START_S


BIN_NAMES: tuple[tuple[str, int], ...] = tuple(
    (phase, i) for phase in PHASE_NAMES for i in range(len(_edges(phase)) + 1)
)
_FIRST_BIN = {phase: next(k for k, (p, _) in enumerate(BIN_NAMES) if p == phase) for phase in PHASE_NAMES}
OUTSIDE = len(BIN_NAMES)


def bins_of(trial: CellTrial, z0_mm: float) -> IntArray:
    """Return the bin (n,) of every cell; cells outside all phases fall into the bin ``OUTSIDE``."""
    bins = np.full(len(trial.time_s), OUTSIDE, dtype=np.int64)
    for code, phase in enumerate(PHASE_NAMES):
        mask = trial.phase == code
        if not mask.any():
            continue
        t = trial.time_s[mask]
        if phase in ("approach", "retract"):
            measure = trial.position_mm[mask] - z0_mm
        elif phase in ("ramp", "sweep"):
            measure = (t - t[0]) / max(float(t[-1] - t[0]), 1e-9)
        else:
            measure = t - t[0]
        bins[mask] = _FIRST_BIN[phase] + np.searchsorted(_edges(phase), measure, side="right")
    return bins


@dataclass(frozen=True)
class Profiles:
    """Residual means by trial and bin: ``mean`` (T, B) in units of the signal, ``count`` (T, B) samples.

    ``start_s`` and ``stop_s`` (T, B) are where a bin lies in each trial (NaN where it is absent);
    ``conditions`` (T,) tell which trials are repeats of each other.
    """

    mean: FloatArray
    count: FloatArray
    start_s: FloatArray
    stop_s: FloatArray
    conditions: tuple[str, ...]

    def standardised(self, sample_rms: float) -> FloatArray:
        """Return bin means in units of their white-noise standard error, (T, B); 0 where absent."""
        return np.asarray(self.mean * np.sqrt(self.count) / sample_rms)


def profile(
    trials: Sequence[CellTrial], residuals: Sequence[FloatArray], z0s_mm: Sequence[float]
) -> Profiles:
    """Return the profiles of residuals (n_j,) of trials."""
    size = OUTSIDE + 1
    mean, count = np.zeros((len(trials), size)), np.zeros((len(trials), size))
    start, stop = np.full((len(trials), size), np.nan), np.full((len(trials), size), np.nan)
    for j, (trial, residual, z0) in enumerate(zip(trials, residuals, z0s_mm, strict=True)):
        bins = bins_of(trial, z0)
        use = trial.fitted
        total = np.bincount(bins[use], weights=(residual * trial.counts)[use], minlength=size)
        count[j] = np.bincount(bins[use], weights=trial.counts[use], minlength=size)
        mean[j] = np.divide(total, count[j], out=np.zeros(size), where=count[j] > 0)
        half = 0.5 * trial.counts / trial.sample_rate_hz
        for b in np.unique(bins[use]):
            inside = (bins == b) & use
            start[j, b] = float((trial.time_s - half)[inside].min())
            stop[j, b] = float((trial.time_s + half)[inside].max())
    mean[:, OUTSIDE] = 0.0
    count[:, OUTSIDE] = 0.0
    return Profiles(mean, count, start, stop, tuple(t.condition for t in trials))


def repeatable_energy(standardised: FloatArray, conditions: Sequence[str]) -> FloatArray:
    """Return per bin (B,) the energy that repeats, free of noise on average, summed over trials.

    Products of different trials of one condition have no noise in their mean; a condition met once is paired
    with all others.
    """
    labels = np.asarray(conditions)
    energy = np.zeros(standardised.shape[1])
    lonely = []
    for label in np.unique(labels):
        u = standardised[labels == label]
        n = len(u)
        if n < 2:
            lonely.append(u)
            continue
        total = u.sum(axis=0)
        energy += (total**2 - (u**2).sum(axis=0)) / (n - 1)
    if lonely:
        u = np.concatenate(lonely)
        if len(u) > 1:
            total = u.sum(axis=0)
            energy += (total**2 - (u**2).sum(axis=0)) / (len(u) - 1)
        else:
            energy += np.maximum(u[0] ** 2 - 1.0, 0.0)
    return energy
