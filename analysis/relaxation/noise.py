"""Standard errors that stay honest when the noise is correlated.

The covariance of a least-squares estimate is the variance of a weighted sum of the noise. The noise's
spectrum is measured on the residual: an autoregression whose order the Bayesian criterion chooses,
fitted to means over short cells; where means over sixteen cells vary more than that spectrum says, a
second one at their scale corrects its slow end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import FloatArray

MOST_CELLS = 4000
_SLOW = 16  # cells in a slow cell
_MOST_ORDER = 25
_MOST_SLOW_ORDER = 6
_SLOW_SIGMAS = 3.0


@dataclass(frozen=True, slots=True)
class NoiseSpectrum:
    """What the residual says of the noise.

    ``cell`` samples are averaged first. ``order`` and ``slow_order`` are those of the two
    autoregressions (``slow_order`` None: the first one explains the slow end). ``slow_ratio`` is the
    variance of slow means over what white noise of the same sample variance would give; 1 for white
    noise, with a standard error of ``slow_ratio_se`` then.
    """

    cell: int
    coefficients: FloatArray
    innovation: float
    slow_coefficients: FloatArray | None
    slow_innovation: float
    order: int
    slow_order: int | None
    slow_ratio: float
    slow_ratio_se: float

    def power(self, frequency: FloatArray) -> FloatArray:
        """Return the power (F,) of cell means, variance a cell, at frequencies in cycles a cell."""
        fine = self.innovation / np.abs(_transfer(self.coefficients, frequency)) ** 2
        if self.slow_coefficients is None:
            return fine
        slow_frequency = frequency * _SLOW
        slow = _SLOW * self.slow_innovation / np.abs(_transfer(self.slow_coefficients, slow_frequency)) ** 2
        return np.where(slow_frequency < 0.25, np.maximum(fine, slow), fine)


def measure_noise(residual: FloatArray, n_parameters: int) -> NoiseSpectrum:
    """Return the spectrum of the noise behind a residual (N,) from which ``n_parameters`` were fitted."""
    cell = max(1, len(residual) // MOST_CELLS)
    means = _means(residual, cell)
    freedom = len(means) / max(len(means) - n_parameters, 1)
    order_limit = min(_MOST_ORDER, len(means) // 10)
    coefficients, innovation = _autoregression(means, order_limit, freedom)
    slow = _means(means, _SLOW)
    white = float(np.var(residual)) / (cell * _SLOW)
    if len(slow) <= 2 * n_parameters + 4:
        return NoiseSpectrum(cell, coefficients, innovation, None, 0.0, len(coefficients), None, 1.0, np.inf)
    slow_freedom = len(slow) / (len(slow) - n_parameters)
    slow_variance = float(np.mean(slow**2)) * slow_freedom
    slow_se = float(np.sqrt(2.0 / (len(slow) - n_parameters)))
    frequency: FloatArray = np.fft.rfftfreq(16 * _SLOW).astype(np.float64)
    window = np.abs(np.sinc(_SLOW * frequency) / np.sinc(frequency)) ** 2
    spectrum = innovation / np.abs(_transfer(coefficients, frequency)) ** 2
    both_sides = np.where((frequency == 0) | (frequency == 0.5), 1.0, 2.0)
    expected = float(np.sum(both_sides * spectrum * window) / (16 * _SLOW))
    slow_coefficients, slow_innovation = None, 0.0
    if slow_variance > expected * (1.0 + _SLOW_SIGMAS * slow_se):
        slow_limit = min(_MOST_SLOW_ORDER, len(slow) // 10)
        slow_coefficients, slow_innovation = _autoregression(slow, slow_limit, slow_freedom)
    return NoiseSpectrum(
        cell=cell,
        coefficients=coefficients,
        innovation=innovation,
        slow_coefficients=slow_coefficients,
        slow_innovation=slow_innovation,
        order=len(coefficients),
        slow_order=None if slow_coefficients is None else len(slow_coefficients),
        slow_ratio=slow_variance / max(white, 1e-300),
        slow_ratio_se=slow_se,
    )


def estimate_covariance(
    jacobian: FloatArray, weights: FloatArray, edges: NDArray[np.int64], noise: NoiseSpectrum
) -> FloatArray:
    """Return the covariance (P, P) of the parameters of a weighted least-squares fit to block means.

    ``jacobian`` (P, K) by block, ``weights`` (K,) the samples in each, ``edges`` (K + 1,) their sample
    indices.
    """
    return noise_covariance(influences(jacobian, weights), weights, edges, noise)


def noise_covariance(
    influence: FloatArray, weights: FloatArray, edges: NDArray[np.int64], noise: NoiseSpectrum
) -> FloatArray:
    """Return the covariance (P, P) of sums in which the noise of a sample of block b counts as influence."""
    reached = np.concatenate([np.zeros((len(influence), 1)), np.cumsum(influence * weights, axis=1)], axis=1)
    marks = np.arange(edges[0], edges[-1] + noise.cell, noise.cell)
    cells = np.diff(np.stack([np.interp(marks, edges, row) for row in reached]), axis=1)
    n = 1 << (2 * cells.shape[1] - 1).bit_length()
    transformed = np.fft.rfft(cells, n, axis=1)
    frequency: FloatArray = np.fft.rfftfreq(n).astype(np.float64)
    both_sides = np.where((frequency == 0) | (frequency == 0.5), 1.0, 2.0)
    power = noise.power(frequency) * both_sides / n
    covariance = np.real((transformed * power) @ transformed.conj().T)
    return np.asarray(0.5 * (covariance + covariance.T), dtype=float)


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
    return np.asarray(values[: rows * length].reshape(rows, length).mean(axis=1), dtype=float)


def _transfer(coefficients: FloatArray, frequency: FloatArray) -> NDArray[np.complex128]:
    lags = np.arange(1, len(coefficients) + 1)
    return np.asarray(
        1.0 - np.exp(-2j * np.pi * np.outer(frequency, lags)) @ coefficients, dtype=np.complex128
    )


def _autoregression(values: FloatArray, most: int, freedom: float) -> tuple[FloatArray, float]:
    """Return coefficients (order,) and innovation variance by Levinson's recursion, order by BIC."""
    n = len(values)
    transformed = np.fft.rfft(values, 1 << (2 * n - 1).bit_length())
    covariance = np.fft.irfft(np.abs(transformed) ** 2)[: most + 1] / n * freedom
    best = np.empty(0), float(covariance[0])
    if not covariance[0] > 0:
        return best
    coefficients, innovation = np.empty(0), float(covariance[0])
    best_score = n * np.log(innovation)
    for order in range(1, most + 1):
        reflection = (covariance[order] - coefficients @ covariance[order - 1 : 0 : -1]) / innovation
        if not abs(reflection) < 1:
            break
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        innovation *= 1.0 - reflection**2
        score = n * np.log(innovation) + order * np.log(n)
        if score < best_score:
            best_score, best = score, (coefficients, innovation)
    return best
