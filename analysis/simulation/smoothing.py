"""Smoothing of a recorded motion, and how much of it an acceleration needs."""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

FloatArray = NDArray[np.float64]

WIDTHS_SAMPLES = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 16.0, 32.0, 64.0)
NOISE_ORDER = 4
REACH = 5.0


def smoothed(signal: FloatArray, width_samples: float) -> FloatArray:
    """Return a signal (N,) smoothed by a Gaussian, going on past its ends as it went up to them.

    A recording may begin or end in motion; mirrored there, it would turn round within a sample.
    """
    pad = min(len(signal) - 1, int(np.ceil(REACH * width_samples)) + 1)
    longer = np.pad(signal, pad, mode="reflect", reflect_type="odd")
    return np.asarray(gaussian_filter1d(longer, width_samples)[pad : pad + len(signal)])


def sample_noise(signal: FloatArray) -> float:
    """Return the rms of white noise in a smooth signal (N,), from its fourth differences."""
    jumps = np.abs(np.diff(signal, NOISE_ORDER))
    return float(np.quantile(jumps, 0.9545)) / 2.0 / float(np.sqrt(comb(2 * NOISE_ORDER, NOISE_ORDER)))


def width_for_acceleration(position: FloatArray) -> float:
    """Return the Gaussian width (samples) with which the second derivative of a position (N,) is fit to be fitted with.

    It is half of the width of the smallest error: noise averages out over a fit, what smoothing takes away does not.
    The error is estimated without bias: what smoothing takes from the second derivative, less what of it is noise,
    plus the noise that stays (Stein 1981, for a linear smoother under white noise).
    """
    noise = sample_noise(position)
    impulse = np.zeros(8 * int(WIDTHS_SAMPLES[-1]) + 1)
    impulse[len(impulse) // 2] = 1.0
    inside = slice(2, -2)
    raw, raw_kernel = _second(position)[inside], _second(impulse)
    best, smallest = WIDTHS_SAMPLES[0], np.inf
    for width in WIDTHS_SAMPLES:
        if REACH * width > 0.1 * len(position):
            break
        kernel = _second(smoothed(impulse, width))
        taken = _second(smoothed(position, width))[inside] - raw
        risk = float(np.mean(taken**2)) + noise**2 * float(
            kernel @ kernel - (kernel - raw_kernel) @ (kernel - raw_kernel)
        )
        if risk < smallest:
            best, smallest = width, risk
    return 0.5 * best


def _second(signal: FloatArray) -> FloatArray:
    return np.asarray(np.gradient(np.gradient(signal)))
