"""Smoothing of a recorded motion, and how much of it an acceleration needs."""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import label, maximum, median_filter
from scipy.signal import oaconvolve
from scipy.signal.windows import gaussian
from scipy.special import ndtri

FloatArray = NDArray[np.float64]

WIDTHS_SAMPLES = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 16.0, 32.0, 64.0)
NOISE_ORDER = 4
REACH = 5.0
ENDS = 4.0
"""Widths at which a Gaussian is cut off: beyond lies less than a ten thousandth of it."""
AGREE = 2.0
"""Standard errors within which two smoothed positions are taken for one."""
NEIGHBOURS = 5
"""Samples of which the middle width is taken."""
LEAST_NOISE = 1e-12
"""Of a position without any, mm."""
SAME = 1e-7
"""Of a position's range, within which two values are of one level."""
WIDEST_SHARE = 0.02
"""Of a recording: a wider Gaussian would see its ends everywhere."""


def smoothed(signal: FloatArray, width_samples: float) -> FloatArray:
    """Return a signal (N,) smoothed by a Gaussian, going on past its ends as it went up to them.

    A recording may begin or end in motion; mirrored there, it would turn round within a sample. It is turned about
    where a line through its last samples ends: about the last one, that sample's noise would be a motion.
    """
    pad = min(len(signal) - 1, int(np.ceil(REACH * width_samples)) + 1)
    before = 2.0 * _end(signal[::-1], width_samples) - signal[pad:0:-1]
    after = 2.0 * _end(signal, width_samples) - signal[-2 : -pad - 2 : -1]
    longer = np.concatenate([before, signal, after])
    return np.asarray(oaconvolve(longer, _kernel(width_samples), mode="same")[pad : pad + len(signal)])


def _end(signal: FloatArray, width_samples: float) -> float:
    """Return where a line through as many of the last samples as a Gaussian spans ends."""
    last = signal[-max(int(2.0 * width_samples), 2) :]
    k = np.arange(len(last)) - 0.5 * (len(last) - 1)
    return float(last.mean() + k[-1] * (k @ last) / (k @ k))


def _kernel(width_samples: float) -> FloatArray:
    weights = gaussian(2 * int(ENDS * width_samples + 0.5) + 1, width_samples)
    return np.asarray(weights / weights.sum())


def sample_noise(signal: FloatArray) -> float:
    """Return the rms of white noise in a smooth signal (N,), from its fourth differences."""
    jumps = np.abs(np.diff(signal, NOISE_ORDER))
    return float(np.quantile(jumps, 0.9545)) / 2.0 / float(np.sqrt(comb(2 * NOISE_ORDER, NOISE_ORDER)))


def averaged_noise(signal: FloatArray, samples: int) -> float:
    """Return the rms of white noise of which a mean over so many samples is as noisy as of a smooth signal (N,).

    Noise that neighbours share, as behind a filter, does not average out as white noise does, and a sample tells
    nothing of that. It is from fourth differences of the means, and their median: where a motion turns they are large.
    """
    whole = signal[: len(signal) // samples * samples].reshape(-1, samples).mean(axis=1)
    if len(whole) <= NOISE_ORDER:
        return 0.0
    jump = float(np.median(np.abs(np.diff(whole, NOISE_ORDER)))) / float(ndtri(0.75))
    return jump * float(np.sqrt(samples / comb(2 * NOISE_ORDER, NOISE_ORDER)))


def position_noise(position: FloatArray) -> float:
    """Return the rms error of a sample of a position (N,): of white noise, and no less than its converter's steps make.

    Where noise is smaller than a step samples at rest are all alike, and their differences tell nothing of it. What
    falls anywhere between two levels is off by their distance over sqrt(12), rms (Widrow and Kollar, Quantization
    Noise, 2008). What moves from level to level evenly was not rounded to them.
    """
    noise, moved = sample_noise(position), np.abs(np.diff(position))
    levels = np.diff(np.unique(position))
    levels = levels[levels > SAME * np.ptp(position)]
    if not levels.size:
        return noise
    moves = sliding_window_view(moved, NOISE_ORDER).max(axis=1) > 0.0
    uneven = float(np.median(np.abs(np.diff(position, NOISE_ORDER))[moves]))
    step = float(levels.min())
    return max(noise, step / float(np.sqrt(12.0))) if uneven > 0.5 * step else noise


def width_for_acceleration(position: FloatArray, noise: float) -> float:
    """Return the Gaussian width (samples) with which the second derivative of a position (N,) is fit to be fitted with.

    It is half of the width of the smallest error: noise averages out over a fit, what smoothing takes away does not.
    The error is estimated without bias: what smoothing takes from the second derivative, less what of it is ``noise``
    (rms of a sample), plus the noise that stays (Stein 1981, for a linear smoother under white noise).
    """
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


def width_for_rest(position: FloatArray, noise: float, counts: FloatArray, least_samples: float) -> float:
    """Return the Gaussian width (samples) with which a position (N,) comes nearest to where the arm was.

    At least ``least_samples``; ``counts`` (N,) says how much each sample counts, ``noise`` is its rms error. The error
    is estimated without bias: what smoothing takes away, less what of it is noise, plus the noise that stays (Stein
    1981, for a linear smoother under white noise). Noise that stays is no motion, and would be a force in contact.
    """
    best, smallest, width = least_samples, np.inf, least_samples
    while width <= max(WIDEST_SHARE * len(position), least_samples):
        taken = smoothed(position, width) - position
        risk = float(np.average(taken**2, weights=counts)) + 2.0 * noise**2 * float(_kernel(width).max())
        if risk < smallest:
            best, smallest = width, risk
        width *= 2.0
    return best


def smoothed_as_it_bears(position: FloatArray, noise: float, widest_samples: float) -> FloatArray:
    """Return a position (N,), and its velocity, a sample, smoothed over as much about every sample as it bears, and the
    position's standard error: (3, N).

    A sample's rms error is ``noise``. Of widths of a Gaussian that double the widest is looked for whose result agrees
    with those of all smaller ones, intervals of two standard errors having a point in common: it ends where a motion
    turns, for a velocity elsewhere than for a position (intersection of confidence intervals: Goldenshluger and
    Nemirovski, Math. Methods Stat. 6:135, 1997). Half of it is taken: noise averages out over a fit, what smoothing
    takes away does not. A velocity that is no more than its noise is none, as in `steady_velocity`.

    At rest ``widest_samples`` are to be many: what stays of noise there, a dashpot and a delay together smooth away.
    """
    rows, errors, width = [position], [[1.0, float(np.sqrt(0.5))]], WIDTHS_SAMPLES[0]
    while width <= 2.0 * widest_samples:
        kernel = _kernel(width)
        rows.append(smoothed(position, width))
        errors.append([float(np.linalg.norm(x)) for x in (kernel, np.gradient(kernel))])
        width *= 2.0
    positions = np.array(rows)
    of_position, of_velocity = noise * np.array(errors).T
    found, error = _widest_that_agree(positions, of_position)
    velocity, of_it = _widest_that_agree(np.gradient(positions, axis=1), of_velocity)
    return np.array([found, np.where(beyond_noise(velocity, of_it), velocity, 0.0), error])


def beyond_noise(signal: FloatArray, error: FloatArray) -> NDArray[np.bool_]:
    """Return where a signal (N,) of some standard errors (N,) is no noise: two of them, more than noise somewhere.

    More than noise is what is beyond the universal threshold; a stretch, as of motion, begins and ends below that
    (hysteresis: Canny, IEEE Trans. Pattern Anal. 8:679, 1986).
    """
    errors = np.abs(signal) / np.maximum(error, LEAST_NOISE)
    stretches, n = label(errors > AGREE)
    most = maximum(errors, stretches, np.arange(1, n + 1))
    return np.asarray(np.append(0.0, most)[stretches] > np.sqrt(2.0 * np.log(len(signal))))


def _widest_that_agree(rows: FloatArray, errors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return of rows (W, N), ever more smoothed, one before the last that agrees at every sample, and its error (N,).

    ``errors`` (W,) are the rows' standard ones.
    """
    lower, upper, agree = -np.inf, np.inf, np.zeros(rows.shape[1], dtype=np.int64)
    for row, error in zip(rows, errors, strict=True):
        lower, upper = np.maximum(lower, row - AGREE * error), np.minimum(upper, row + AGREE * error)
        agree += lower <= upper
    # one sample far off is no turn
    half = np.maximum(median_filter(agree, NEIGHBOURS) - 2, 0)
    return np.take_along_axis(rows, half[None], axis=0)[0], errors[half]


def share_that_stays(width_samples: float) -> float:
    """Return what smoothing leaves of white noise, as a share of its rms."""
    return float(np.linalg.norm(_kernel(width_samples)))


def steady_velocity(position: FloatArray, noise: float, width_samples: float) -> FloatArray:
    """Return the velocity (N,) of a smoothed position (N,), a sample, none where it is no more than its ``noise`` (rms)
    makes it.

    What rests wanders as far in a minute as the noise of its velocity makes it, and bristles would bend and slide by
    that. The soft threshold is the universal one (Donoho and Johnstone, Biometrika 81:425, 1994).
    """
    velocity = np.gradient(smoothed(position, width_samples))
    of_velocity = noise * float(np.linalg.norm(np.gradient(_kernel(width_samples))))
    threshold = of_velocity * np.sqrt(2.0 * np.log(len(position)))
    return np.asarray(np.sign(velocity) * np.maximum(np.abs(velocity) - threshold, 0.0))


def _second(signal: FloatArray) -> FloatArray:
    return np.asarray(np.gradient(np.gradient(signal)))
