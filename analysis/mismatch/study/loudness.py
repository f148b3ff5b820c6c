"""How much louder a force channel is under force than where nothing is touched."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import comb
from scipy.stats import chi2, ttest_1samp

from analysis.mismatch.levels import FEWEST_HELD_OUT
from analysis.simulation.cells import CellTrial
from analysis.simulation.smoothing import NOISE_ORDER

FloatArray = NDArray[np.float64]

BLOCK = 64
"""Independent differences of which one force and one noise are read."""
FEWEST_BLOCKS = 8
RARELY = 1e-3
"""Level of the test; what noise grows by chance is nothing that matters."""
AT_REST = ("hold", "dwell", "sweep")


def with_loudness(trials: Sequence[CellTrial]) -> list[CellTrial]:
    """Return the trials with how much louder their white noise is in each cell than at rest, where it grows with force.

    A sensor's gain that flickers makes noise of sd^2 = a (1 + b F^2). H0: noise is alike at any force, so that the
    slope b of a trial's squared differences, by least squares, is above nothing by chance (t test over trials).
    """
    pressed_mn = [t.force_mn - t.offset_start_mn for t in trials]
    largest_mn = max(float(np.abs(pressed).max()) for pressed in pressed_mn)
    slopes = [s for t in trials if (s := _slope(t, largest_mn)) is not None]
    if len(slopes) < FEWEST_HELD_OUT or not np.ptp(slopes) > 0.0:
        return list(trials)
    if ttest_1samp(slopes, 0.0, alternative="greater").pvalue > RARELY:
        return list(trials)
    grows = float(np.mean(slopes))
    squares = [1.0 + grows * (pressed / largest_mn) ** 2 for pressed in pressed_mn]
    rests = [t.in_phase(*AT_REST) * t.counts for t in trials]
    rested = sum(float(r.sum()) for r in rests)
    rest = sum(float(r @ s) for r, s in zip(rests, squares, strict=True)) / rested if rested else 1.0
    return [replace(t, louder=np.sqrt(s / rest)) for t, s in zip(trials, squares, strict=True)]


def _slope(trial: CellTrial, largest_mn: float) -> float | None:
    """Return by how much of what it is without force a trial's noise variance grows to the largest force."""
    force_mn = trial.full_force_mn.astype(np.float64)
    # those that share no sample are independent
    jumps = np.diff(force_mn, NOISE_ORDER)[:: NOISE_ORDER + 1]
    blocks = len(jumps) // BLOCK
    if blocks < FEWEST_BLOCKS or trial.uneven_s is not None or trial.levels is not None:
        return None
    at = (np.arange(blocks * BLOCK) * (NOISE_ORDER + 1)).reshape(blocks, BLOCK)
    middle_mn = np.median(force_mn[at], axis=1) - trial.offset_start_mn
    # a median, as a motion that turns and a spike are large
    variance = np.median(jumps[: blocks * BLOCK].reshape(blocks, BLOCK) ** 2, axis=1)
    variance /= comb(2 * NOISE_ORDER, NOISE_ORDER) * chi2.median(1)
    slope, still = np.polyfit((middle_mn / largest_mn) ** 2, variance, 1)
    return float(slope / still) if still > 0.0 else None
