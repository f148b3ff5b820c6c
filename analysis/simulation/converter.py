"""A converter's levels: what a force that lies between two of them is read as, on average, and back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d, uniform_filter1d
from scipy.optimize import brentq
from scipy.special import comb, ndtr, ndtri

from analysis.simulation.smoothing import NOISE_ORDER

FloatArray = NDArray[np.float64]

COARSE = 2.0
"""Deviations of the noise between two levels, from which a mean shows them: at fewer it is right to a two-hundredth."""
TERMS = 4
USUAL = 0.999
"""Share of a force's differences that are noise, and neither kinks nor sparks."""
ON_LEVELS = 0.02
"""Share of a level by which what was rounded to levels is off them, on average: other values are off by a quarter."""
LEAST_NOISE = 0.15
"""In levels: with less noise a reading is hardly a number."""
STANDS = 0.25
"""Levels by which what is averaged may go on: of more the mean shows no levels."""
WIDTHS = (1, 3, 9, 27)
"""Means that are taken together."""
PLACES = 401
LEAST_CHANCE = 1e-300


@dataclass(frozen=True)
class Levels:
    """Levels ``apart_mn`` from each other, one of them ``at_mn``, and the noise before it was rounded, mN rms."""

    apart_mn: float
    at_mn: float
    noise_mn: float

    def mean_read(self, force_mn: FloatArray) -> FloatArray:
        """Return the mean reading (n,) of forces with their noise, mN.

        The mean error of rounding is (L / pi) sum (-1)^k / k exp(-2 (pi k sigma / L)^2) sin(2 pi k F / L), L apart
        (Widrow and Kollar, Quantization Noise, 2008).
        """
        u = (force_mn - self.at_mn) / self.apart_mn
        read = np.array(force_mn)
        for k in range(1, TERMS + 1):
            size = (-1) ** k / (np.pi * k) * np.exp(-2.0 * (np.pi * k * self.noise_mn / self.apart_mn) ** 2)
            read += self.apart_mn * size * np.sin(2.0 * np.pi * k * u)
        return read

    def before_rounding(self, mean_mn: FloatArray, counts: FloatArray) -> FloatArray:
        """Return the forces (n,) of which these are the mean readings, of so many samples (n,) each.

        Where a force lies is told by as many means as go on by less than a share of a level: of few samples all may
        lie on one. Where it goes on by levels it stays as it was read.
        """
        force_mn = np.array(mean_mn)
        for cells in WIDTHS:
            wide_mn = uniform_filter1d(mean_mn, cells)
            stands = cells * np.abs(np.gradient(wide_mn)) < STANDS * self.apart_mn
            told = stands & (minimum_filter1d(counts, cells, mode="constant") > 1)
            force_mn[told] = (mean_mn + self._unrounded(wide_mn) - wide_mn)[told]
        return force_mn

    def _unrounded(self, mean_mn: FloatArray) -> FloatArray:
        u = np.linspace(-0.5, 0.5, PLACES) * self.apart_mn
        nearest = self.at_mn + self.apart_mn * np.round((mean_mn - self.at_mn) / self.apart_mn)
        return nearest + np.interp(mean_mn - nearest, self.mean_read(self.at_mn + u) - self.at_mn, u)

    def drawn_error(
        self, read_mn: NDArray[np.floating[Any]], force_mn: FloatArray, random: np.random.Generator
    ) -> FloatArray:
        """Return noise (N,) by which forces were read as they were: where between two levels is drawn, mN.

        Rounding scatters more between two levels than on one; this does not (Dunn and Smyth, J. Comput. Graph. Stat.
        5:236, 1996).
        """
        off = (read_mn - force_mn) / self.noise_mn
        half, sign = 0.5 * self.apart_mn / self.noise_mn, np.where(off > 0.0, -1.0, 1.0)
        # in the lower tail, where a chance is known to its own size
        lower, upper = (ndtr(sign * off + end) for end in (-half, half))
        chance = lower + random.random(len(off)) * (upper - lower)
        return np.asarray(self.noise_mn * sign * ndtri(np.maximum(chance, LEAST_CHANCE)))


def levels_of(force_mn: FloatArray) -> Levels | None:
    """Return the levels that a force (N,) was rounded to; None where noise goes over many, and no mean shows them."""
    values = np.unique(force_mn)
    gaps = np.diff(values)
    if not gaps.size:
        return None
    whole = float(values[-1] - values[0])
    apart = whole / max(round(whole / float(np.median(gaps))), 1)
    of_levels = (values - values[0]) / apart
    if float(np.mean(np.abs(of_levels - np.round(of_levels)))) > ON_LEVELS:
        return None
    jumps = np.abs(np.diff(force_mn, NOISE_ORDER))
    scatter = np.mean(np.minimum(jumps, np.quantile(jumps, USUAL)) ** 2) / comb(2 * NOISE_ORDER, NOISE_ORDER)
    noise = apart * _before_rounding(float(scatter) / apart**2)
    return Levels(apart, float(values[0]), noise) if apart > COARSE * noise else None


def _before_rounding(scatter: float) -> float:
    """Return the rms of noise that, rounded to whole numbers, has this variance about its mean wherever that lies.

    Rounding adds 1/12 to the mean square of what is read less what is true, of which the mean error is no scatter.
    """
    k = np.arange(1, TERMS + 1)

    def too_large(noise: float) -> float:
        of_mean = float(np.sum(np.exp(-((2.0 * np.pi * k * noise) ** 2)) / (np.pi * k) ** 2)) / 2.0
        return noise**2 + 1.0 / 12.0 - of_mean - scatter

    most = LEAST_NOISE + float(np.sqrt(scatter))
    return float(brentq(too_large, LEAST_NOISE, most)) if too_large(LEAST_NOISE) < 0.0 else LEAST_NOISE
