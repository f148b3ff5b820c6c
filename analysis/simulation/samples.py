"""Single samples and their neighbours: how far one is off them, and how far it may be off as noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

FloatArray = NDArray[np.float64]

NEIGHBOURS = 9
"""Samples whose median is the level of the middle one: a step, however steep, moves it along."""
FAR = 8.0
"""Robust deviations from which a sample is further off than noise, but for the rarest of a heavy tail."""

SHORT = 1e-3
"""Of a process' time: a mean over no more than this is a sample, to a line."""


def kept_by_mean(times: NDArray[Any]) -> NDArray[Any]:
    """Return what share of an Ornstein-Uhlenbeck process' variance a mean over so many of its times u has.

    It is 2 (u - 1 + e^-u) / u^2. Of a process that turns too, u is complex, and the share its real part.
    """
    long = np.abs(times) > SHORT
    u = np.where(long, times, SHORT)
    return np.where(long, 2.0 * (u + np.expm1(-u)) / u**2, 1.0 - times / 3.0)


@dataclass(frozen=True)
class Scatter:
    """How far samples (n,) are off their neighbours' median, in robust deviations, and one of these, mN."""

    off: FloatArray
    sigma_mn: float


def deviations(force_mn: FloatArray, kept: NDArray[np.bool_], level_mn: float = 0.0) -> Scatter:
    """Return how the kept samples of a force (N,) scatter about their neighbours.

    A force on levels so far apart is known to their distance over sqrt(12), however seldom it goes from one to the next
    (Widrow and Kollar, Quantization Noise, 2008).
    """
    off = (force_mn - median_filter(force_mn, NEIGHBOURS, mode="nearest"))[kept]
    if not off.size:
        return Scatter(off, 1.0)
    # of few levels, as of a coarse converter, the median of the deviations may be none
    usual = (1.4826 * float(np.median(np.abs(off))), float(np.mean(np.abs(off))), level_mn / np.sqrt(12.0))
    sigma_mn = max(*usual, 1e-12)
    return Scatter(off / sigma_mn, sigma_mn)


def winsorised(force_mn: FloatArray, kept: NDArray[np.bool_], level_mn: float = 0.0) -> FloatArray:
    """Return a force (N,) of which no kept sample is further off its neighbours' median than `FAR` deviations.

    It may be on levels so far apart.

    The mean of a few samples of which one is in a heavy tail would look like something that happened there
    (Huber, Ann. Math. Statist. 35:73, 1964).
    """
    scatter = deviations(force_mn, kept, level_mn)
    # on a slope each is its neighbours' median: what it is off the line between two tells the noise there
    off_mn = force_mn[1:-1] - 0.5 * (force_mn[:-2] + force_mn[2:])
    of_line_mn = np.abs(off_mn[kept[1:-1]])
    noise_mn = 1.4826 * float(np.median(of_line_mn)) / np.sqrt(1.5) if of_line_mn.size else 0.0
    most = FAR * max(noise_mn / scatter.sigma_mn, 1.0)
    found = np.array(force_mn, dtype=np.float64)
    found[kept] -= scatter.sigma_mn * (scatter.off - np.clip(scatter.off, -most, most))
    return found
