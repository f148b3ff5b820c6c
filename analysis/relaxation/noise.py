"""Standard errors that stay honest when the noise is correlated.

The covariance of a least-squares estimate is the variance of a weighted sum of the noise. The noise's
spectrum is measured on the residual: an autoregression whose order the Bayesian criterion chooses,
fitted to means over short cells; where means over eight cells correlate as well, a second one at their
scale gives the slow end.

A spectrum taken from one residual is itself uncertain: where the noise is as slow as a tenth of a second,
a hold of seven knows the variance of an estimate to some 40 %, so that its error follows Student's
distribution with some ten degrees of freedom. How uncertain follows from the autoregressions'
asymptotic covariance; a standard error is here the standard deviation of that distribution,
sqrt(n / (n - 2)) times the plain one at n degrees of freedom (JCGM 101:2008, 6.4.9).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import FloatArray
from analysis.relaxation.autoregression import Autoregression, fit_autoregression, measured_covariances
from analysis.relaxation.motion import sample_noise

MOST_CELLS = 2000
_SLOW = 8  # cells in a slow cell
_MOST_ORDER = 25
_MOST_SLOW_ORDER = 6
_RESTORING_ROUNDS = 3
_FREQUENCIES = 512  # that say how unsure the fine autoregression is
_LEAST_FREEDOM = 3.0  # below, Student's distribution has no finite spread


@dataclass(frozen=True, slots=True)
class NoiseSpectrum:
    """What the residual says of the noise.

    ``fine`` is the autoregression of means over ``cell`` samples, ``slow`` that of means over eight of
    them (None: the first one explains the slow end). ``slow_ratio`` is the variance of slow means over
    what white noise of the same sample variance would give; 1 for white noise, with a standard error of
    ``slow_ratio_se`` then.
    """

    cell: int
    fine: Autoregression
    slow: Autoregression | None = None
    slow_ratio: float = 1.0
    slow_ratio_se: float = np.inf

    def power(self, frequency: FloatArray) -> FloatArray:
        """Return the power (F,) of cell means, variance a cell, at frequencies in cycles a cell."""
        fine = self.fine.power(frequency)
        if self.slow is None:
            return fine
        return np.where(self._is_slow(frequency), _SLOW * self.slow.power(_SLOW * frequency), fine)

    def doubts(self, frequency: FloatArray) -> list[tuple[NDArray[np.bool_], FloatArray]]:
        """Return which frequencies (F,) each autoregression says, and its doubts of log power there."""
        slow = self._is_slow(frequency)
        parts = [(~slow, self.fine.doubts(frequency[~slow]))]
        if self.slow is not None:
            parts.append((slow, self.slow.doubts(_SLOW * frequency[slow])))
        return parts

    def _is_slow(self, frequency: FloatArray) -> NDArray[np.bool_]:
        if self.slow is None:
            return np.zeros(len(frequency), dtype=bool)
        louder = _SLOW * self.slow.power(_SLOW * frequency) > self.fine.power(frequency)
        return louder & (_SLOW * frequency < 0.25)


def measure_noise(residual: FloatArray, jacobian: FloatArray, edges: NDArray[np.int64]) -> NoiseSpectrum:
    """Return the spectrum of the noise behind a residual (N,) of a least-squares fit.

    ``jacobian`` (P, K) holds the model's derivatives by the fitted parameters over blocks whose sample
    indices are ``edges`` (K + 1,): what of the noise the fit has swallowed is given back.
    """
    n_parameters = len(jacobian)
    cell = max(1, len(residual) // MOST_CELLS)
    means = _means(residual, cell)
    freedom = max(len(means) - n_parameters, 1) / len(means)
    covariances = measured_covariances(means, min(_MOST_ORDER, len(means) // 10))
    seen = min(len(means), _FREQUENCIES)
    fine = fit_autoregression(covariances / freedom, np.full(seen, freedom * len(means) / seen))
    slow = _means(means, _SLOW)
    if len(slow) <= 2 * n_parameters + 4:
        return NoiseSpectrum(cell, fine)
    slow_variance = float(np.mean(np.square(slow))) * len(slow) / (len(slow) - n_parameters)
    white = float(np.var(residual)) / (cell * _SLOW)
    swallowed = _cell_sums(jacobian, edges, cell * _SLOW)[:, : len(slow)]
    found = _restored_autoregression(slow, swallowed)
    return NoiseSpectrum(
        cell,
        fine,
        found if len(found.coefficients) else None,
        slow_ratio=slow_variance / max(white, 1e-300),
        slow_ratio_se=float(np.sqrt(2.0 / (len(slow) - n_parameters))),
    )


def neighbouring_noise(residual: FloatArray) -> NoiseSpectrum:
    """Return white noise as strong as neighbouring slow means of a residual (N,) differ.

    What a wrong law leaves in a residual changes slowly, so that neighbours share it: it does not count
    as noise here, and can't excuse itself.
    """
    cell = max(1, len(residual) // MOST_CELLS)
    slow = _means(residual, cell * _SLOW)
    sample = sample_noise(residual) ** 2 / cell
    power = float(np.mean(np.square(np.diff(slow)))) / 2.0 * _SLOW if len(slow) > 8 else sample
    return NoiseSpectrum(cell, Autoregression(np.empty(0), max(power, sample), np.ones(max(len(slow), 1))))


def _restored_autoregression(slow: FloatArray, swallowed: FloatArray) -> Autoregression:
    """Return the autoregression of slow means (M,) whose residual lost what lies along ``swallowed`` (P, M).

    The residual's covariance is (I - Q Q') C (I - Q Q'): what that takes from each lag, under the
    spectrum found so far, is added to the measured lag, and the spectrum found again.
    """
    n = len(slow)
    most = min(_MOST_SLOW_ORDER, n // 10)
    measured = measured_covariances(slow, most)
    scale = np.sqrt(np.maximum(np.sum(np.square(swallowed), axis=1, keepdims=True), 1e-300))
    q, _ = np.linalg.qr((swallowed / scale).T)
    taken = np.square(np.abs(np.fft.fft(q, axis=0))).sum(axis=1) / n
    kept = np.maximum(1.0 - taken, 0.0)
    found = fit_autoregression(measured * n / max(n - q.shape[1], 1), kept)
    if not len(found.coefficients):
        return found
    lags = np.arange(n)
    for _ in range(_RESTORING_ROUNDS):
        whole = found.covariances(n)
        matrix = whole[np.abs(lags[:, None] - lags)]
        carried = matrix @ q
        left = matrix - carried @ q.T - q @ carried.T + q @ (q.T @ carried) @ q.T
        seen = np.array([np.trace(left, lag) / n for lag in range(most + 1)])
        biased = whole[: most + 1] * (n - np.arange(most + 1)) / n
        found = fit_autoregression(measured + np.maximum(biased - seen, 0.0), kept)
    return found


def _both_sides(frequency: FloatArray) -> FloatArray:
    """Return how often each frequency of a real transform counts: twice, but for 0 and the highest."""
    return np.where((frequency == 0) | (frequency == 0.5), 1.0, 2.0)


def _cell_sums(by_block: FloatArray, edges: NDArray[np.int64], length: int) -> FloatArray:
    """Return sums over cells of ``length`` samples, (P, M), of what is constant over blocks, (P, K)."""
    reached = np.zeros((len(by_block), len(edges)))
    np.cumsum(by_block * np.diff(edges), axis=1, out=reached[:, 1:])
    marks = np.minimum(np.arange(edges[0], edges[-1] + length, length), edges[-1])
    at = np.minimum(np.searchsorted(edges, marks, side="right") - 1, by_block.shape[1] - 1)
    return np.diff(reached[:, at] + by_block[:, at] * (marks - edges[at]), axis=1)


def estimate_covariance(jacobian: FloatArray, edges: NDArray[np.int64], noise: NoiseSpectrum) -> FloatArray:
    """Return the covariance (P, P) of the parameters of a least-squares fit to block means.

    ``jacobian`` (P, K) by block, ``edges`` (K + 1,) their sample indices; every sample counts alike.
    """
    influence = influences(jacobian, np.diff(edges).astype(float))
    return widened(*noise_covariance(influence, edges, noise))


def white_error(influence: FloatArray, edges: NDArray[np.int64], noise: NoiseSpectrum) -> float:
    """Return the standard error of a sum in which a sample of block b counts as influence (K,), noise being white."""
    cells = _cell_sums(influence[None], edges, noise.cell)
    return float(np.sqrt(noise.fine.innovation * np.sum(np.square(cells))))


def noise_covariance(
    influence: FloatArray, edges: NDArray[np.int64], noise: NoiseSpectrum
) -> tuple[FloatArray, FloatArray]:
    """Return the covariance (P, P) of sums in which the noise of a sample of block b counts as influence.

    With it the variance (P,) that each element of its diagonal has as an estimate, the spectrum being one.
    """
    from scipy.fft import next_fast_len

    cells = _cell_sums(influence, edges, noise.cell)
    n = next_fast_len(2 * cells.shape[1], real=True)
    transformed = np.fft.rfft(cells, n, axis=1)
    frequency: FloatArray = np.fft.rfftfreq(n).astype(np.float64)
    root = np.sqrt(noise.power(frequency) * _both_sides(frequency) / n)
    real, imaginary = transformed.real * root, transformed.imag * root
    covariance = real @ real.T + imaginary @ imaginary.T
    by_frequency = np.square(real) + np.square(imaginary)
    doubt = np.zeros(len(cells))
    for part, weights in noise.doubts(frequency):
        doubt += np.square(by_frequency[:, part] @ weights).sum(axis=1)
    return np.asarray(0.5 * (covariance + covariance.T), dtype=float), doubt


def widened(covariance: FloatArray, doubt: FloatArray) -> FloatArray:
    """Return the covariance (P, P) of Student's distributions from a plain one and its ``doubt`` (P,).

    The log of a variance with n degrees of freedom scatters by about 2 / (n - 1): so n is found, as
    Satterthwaite did, from what scatters alike.
    """
    variance = np.maximum(np.diag(covariance), 1e-300)
    freedom = np.maximum(1.0 + 2.0 * np.square(variance) / np.maximum(doubt, 1e-300), _LEAST_FREEDOM)
    factor = np.sqrt(freedom / (freedom - 2.0))
    return np.asarray(covariance * factor * factor[:, None], dtype=float)


def influences(jacobian: FloatArray, weights: FloatArray) -> FloatArray:
    """Return what one sample in block b adds to each estimate, (P, K), per unit of noise."""
    scale = np.sqrt(np.maximum(np.sum(weights * jacobian**2, axis=1), 1e-300))
    scaled = jacobian / scale[:, None]
    normal = (scaled * weights) @ scaled.T
    return np.asarray(
        np.linalg.pinv(normal, rcond=1e-14, hermitian=True) @ scaled / scale[:, None], dtype=float
    )


def _means(values: FloatArray, length: int) -> FloatArray:
    rows = len(values) // length
    return np.add.reduceat(values[: rows * length], np.arange(0, rows * length, length)) / length
