"""How long a tone keeps its phase: one that does is taken out of recordings, one that loses it is noise of a band."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from analysis.mismatch.fit.noise import Band
from analysis.mismatch.levels import ENOUGH_SHARED

FloatArray = NDArray[np.float64]

LOWEST_BAND_HZ = 5.0
"""From here on what sways may be an instrument's: below it bodies breathe, and their pulses have overtones."""
FIRST_SHARES = (0.03, 0.3)
"""Of a stretch, from which the time is looked for that a tone keeps its phase."""
LEAST_CYCLES = 0.5
LAGS = 512


def sways(
    spectra: FloatArray, local: FloatArray, at: int, near: NDArray[np.intp], rate_hz: float
) -> Band | None:
    """Return a tone that loses its phase as noise of a band; None of one that keeps it, or leads to what bodies do.

    ``spectra`` (S, F) are periodograms of stretches through a Hann window, ``local`` (S, F) their background, ``at``
    the bin of the line, ``near`` (B,) those in which it is looked at.
    H0: the tone lasts, so that the window alone makes it wide. H1: its correlation falls off as exp(-|lag| / t).
    Statistic: the difference of Whittle's log likelihoods of the periodograms at their best, each value exponential
    about its mean (Whittle, J. R. Stat. Soc. B 15:125, 1953).
    """
    n = 2 * (spectra.shape[1] - 1)
    seen, background = spectra[:, near], np.maximum(local[:, near], 1e-300)
    window = np.hanning(LAGS)
    acf = np.correlate(window, window, "full")[LAGS - 1 :] / float(window @ window)
    lag = np.arange(LAGS) * (n / LAGS)

    def shape(bin_at: float, share: float) -> FloatArray:
        """Return the mean periodogram of a tone of unit variance that keeps its phase for a share of a stretch."""
        kept = acf * (np.exp(-lag / (share * n)) if share < np.inf else 1.0)
        turned = np.cos(2.0 * np.pi * np.outer(near - bin_at, lag) / n)
        return np.asarray((turned @ kept - 0.5 * kept[0]) * (n / LAGS))

    def deviance(of: FloatArray) -> float:
        """Return it of logarithms of size and background, the bin, and the logarithm of a share; without, it lasts."""
        share = float(np.exp(np.clip(of[3], -12.0, 6.0))) if len(of) > 3 else np.inf
        # the background was read beside a tone as wide, too
        mean = np.exp(of[1]) * background + np.exp(of[0]) * np.maximum(shape(of[2], share), 0.0)
        return float(np.sum(seen / mean + np.log(mean)))

    peak = float(np.sum(seen - background, axis=1).mean())
    first = [float(np.log(max(peak, 1e-300) / float(shape(float(at), np.inf).sum()))), 0.0, float(at)]
    lasts = minimize(deviance, first, method="Nelder-Mead")
    found = [minimize(deviance, [*first, np.log(share)], method="Nelder-Mead") for share in FIRST_SHARES]
    best = min(found, key=lambda result: float(result.fun))
    if float(lasts.fun) - float(best.fun) < ENOUGH_SHARED:
        return None
    frequency_hz, lasts_s = float(best.x[2]) * rate_hz / n, float(np.exp(best.x[3])) * n / rate_hz
    if frequency_hz < LOWEST_BAND_HZ:
        # an overtone of a pulse leads to the pulse
        return None
    return Band(float(np.exp(best.x[0])), frequency_hz, max(lasts_s, LEAST_CYCLES / frequency_hz))
