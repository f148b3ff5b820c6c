"""Tones whose frequency wanders: no line, no band, but a spectrum that is not the same from moment to moment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import get_window
from scipy.stats import norm

FloatArray = NDArray[np.float64]

WINDOW_S = 0.064
LOWEST_HZ = 30.0
FEWEST_WINDOWS = 8
OVERLAP = 1.0 + 2.0 / 36.0


@dataclass(frozen=True, slots=True)
class WanderingTone:
    """A band in which power comes and goes, and the chance that noise does that in any of the bands looked at.

    ``rms`` of what comes and goes, in units of the residual.
    """

    lower_hz: float
    upper_hz: float
    rms: float
    p_value: float


def wandering_tone(stretches: Sequence[FloatArray], sample_rate_hz: float) -> WanderingTone | None:
    """Return the octaves in which the spectrum of stretches at rest (each (n,)) is least steady; None if too short.

    Of steady Gaussian noise the power in a window and a bin is exponential, and its mean square twice the square of
    its mean (spectral kurtosis; Antoni, Mech. Syst. Signal Process. 20:282, 2006). A tone that is now here and now
    there adds to the mean square. Power is taken relative to its mean over the windows of the stretch, for the
    spectrum's shape, and over the bins of the window, for noise whose level changes.
    """
    size = round(WINDOW_S * sample_rate_hz)
    if size < 16:
        return None
    taper = get_window("hann", size)
    frequency = np.fft.rfftfreq(size, 1.0 / sample_rate_hz)
    # neighbouring bins of a tapered window share their noise: every other one
    used = np.flatnonzero((frequency >= LOWEST_HZ) & (frequency < 0.49 * sample_rate_hz))[::2]
    excess, variance, level = np.zeros(len(used)), 0.0, np.zeros(len(used))
    for r in stretches:
        if len(r) < FEWEST_WINDOWS * size:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(r, size)[:: size // 2]
        power = np.abs(np.fft.rfft(windows * taper, axis=1)[:, used]) ** 2
        n, m = power.shape
        by_bin = power.mean(axis=0)
        x = power / by_bin
        x /= x.mean(axis=1, keepdims=True)
        excess += n * ((x**2).mean(axis=0) * (n + 1) / n * (m + 1) / m / 2.0 - 1.0)
        # of exponentials half of m2 / m1^2 has the variance 1 / n; windows that overlap by half share a 36th
        variance += n * OVERLAP
        level += n * by_bin
    if not variance:
        return None
    edges = LOWEST_HZ * 2.0 ** np.arange(1.0 + np.ceil(np.log2(0.49 * sample_rate_hz / LOWEST_HZ)))
    found = []
    pairs = list(combinations(edges, 2))
    for low, high in pairs:
        inside = (frequency[used] >= low) & (frequency[used] < high)
        bins = int(inside.sum())
        if not bins:
            continue
        p_value = len(pairs) * norm.sf(float(excess[inside].sum() / np.sqrt(bins * variance)))
        # a tone of m times the noise, in each of F bins for the Fth part of the time, has an excess of m^2 / 2 F
        times = np.sqrt(2.0 * max(float(excess[inside].sum()), 0.0) / variance)
        rms = np.sqrt(2.0 * times * float(level[inside].mean()) / variance) / float(taper.sum())
        found.append(WanderingTone(float(low), float(high), float(rms), min(1.0, float(p_value))))
    return min(found, default=None, key=lambda tone: tone.p_value)
