"""Standard errors that stay honest when the noise is correlated.

The covariance of a least-squares estimate is the variance of a weighted sum of the noise. The noise's
spectrum is measured on the residual: an autoregression whose order the Bayesian criterion chooses,
fitted to means over short cells; where means over eight cells correlate as well, a second one at their
scale gives the slow end.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import FloatArray
from analysis.relaxation.motion import sample_noise

MOST_CELLS = 2000
_SLOW = 8  # cells in a slow cell
_MOST_ORDER = 25
_MOST_SLOW_ORDER = 6
_RESTORING_ROUNDS = 3


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


def measure_noise(residual: FloatArray, jacobian: FloatArray, edges: NDArray[np.int64]) -> NoiseSpectrum:
    """Return the spectrum of the noise behind a residual (N,) of a least-squares fit.

    ``jacobian`` (P, K) holds the model's derivatives by the fitted parameters over blocks whose sample
    indices are ``edges`` (K + 1,): what of the noise the fit has swallowed is given back.
    """
    n_parameters = len(jacobian)
    cell = max(1, len(residual) // MOST_CELLS)
    means = _means(residual, cell)
    freedom = len(means) / max(len(means) - n_parameters, 1)
    order_limit = min(_MOST_ORDER, len(means) // 10)
    coefficients, innovation = _autoregression(_covariances(means, order_limit) * freedom, len(means))
    slow = _means(means, _SLOW)
    none = NoiseSpectrum(cell, coefficients, innovation, None, 0.0, len(coefficients), None, 1.0, np.inf)
    if len(slow) <= 2 * n_parameters + 4:
        return none
    slow_variance = float(np.mean(np.square(slow))) * len(slow) / (len(slow) - n_parameters)
    slow_se = float(np.sqrt(2.0 / (len(slow) - n_parameters)))
    white = float(np.var(residual)) / (cell * _SLOW)
    known = replace(none, slow_ratio=slow_variance / max(white, 1e-300), slow_ratio_se=slow_se)
    swallowed = _cell_sums(jacobian, edges, cell * _SLOW)[:, : len(slow)]
    slow_coefficients, slow_innovation = _restored_autoregression(slow, swallowed)
    if not len(slow_coefficients):
        return known
    return replace(
        known,
        slow_coefficients=slow_coefficients,
        slow_innovation=slow_innovation,
        slow_order=len(slow_coefficients),
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
    return NoiseSpectrum(cell, np.empty(0), max(power, sample), None, 0.0, 0, None, 1.0, np.inf)


def _restored_autoregression(slow: FloatArray, swallowed: FloatArray) -> tuple[FloatArray, float]:
    """Return the autoregression of slow means (M,) whose residual lost what lies along ``swallowed`` (P, M).

    The residual's covariance is (I - Q Q') C (I - Q Q'): what that takes from each lag, under the
    spectrum found so far, is added to the measured lag, and the spectrum found again.
    """
    n = len(slow)
    most = min(_MOST_SLOW_ORDER, n // 10)
    measured = _covariances(slow, most)
    scale = np.sqrt(np.maximum(np.sum(np.square(swallowed), axis=1, keepdims=True), 1e-300))
    q, _ = np.linalg.qr((swallowed / scale).T)
    coefficients, innovation = _autoregression(measured * n / max(n - q.shape[1], 1), n)
    if not len(coefficients):
        return coefficients, innovation
    lags = np.arange(n)
    for _ in range(_RESTORING_ROUNDS):
        whole = _covariances_of(coefficients, innovation, n)
        matrix = whole[np.abs(lags[:, None] - lags)]
        carried = matrix @ q
        left = matrix - carried @ q.T - q @ carried.T + q @ (q.T @ carried) @ q.T
        seen = np.array([np.trace(left, lag) / n for lag in range(most + 1)])
        biased = whole[: most + 1] * (n - np.arange(most + 1)) / n
        coefficients, innovation = _autoregression(measured + np.maximum(biased - seen, 0.0), n)
    return coefficients, innovation


def _covariances_of(coefficients: FloatArray, innovation: float, n: int) -> FloatArray:
    """Return the autocovariances (n,) of an autoregression, from its spectrum."""
    length = 1 << (4 * n - 1).bit_length()
    frequency: FloatArray = np.fft.rfftfreq(length).astype(np.float64)
    return np.asarray(
        np.fft.irfft(innovation / np.abs(_transfer(coefficients, frequency)) ** 2)[:n], dtype=float
    )


def _both_sides(frequency: FloatArray) -> FloatArray:
    """Return how often each frequency of a real transform counts: twice, but for 0 and the highest."""
    return np.where((frequency == 0) | (frequency == 0.5), 1.0, 2.0)


def _cell_sums(by_block: FloatArray, edges: NDArray[np.int64], length: int) -> FloatArray:
    """Return sums over cells of ``length`` samples, (P, M), of what is constant over blocks, (P, K)."""
    weighted = by_block * np.diff(edges)
    reached = np.concatenate([np.zeros((len(by_block), 1)), np.cumsum(weighted, axis=1)], axis=1)
    marks = np.arange(edges[0], edges[-1] + length, length)
    return np.diff(np.stack([np.interp(marks, edges, row) for row in reached]), axis=1)


def estimate_covariance(jacobian: FloatArray, edges: NDArray[np.int64], noise: NoiseSpectrum) -> FloatArray:
    """Return the covariance (P, P) of the parameters of a least-squares fit to block means.

    ``jacobian`` (P, K) by block, ``edges`` (K + 1,) their sample indices; every sample counts alike.
    """
    return noise_covariance(influences(jacobian, np.diff(edges).astype(float)), edges, noise)


def noise_covariance(influence: FloatArray, edges: NDArray[np.int64], noise: NoiseSpectrum) -> FloatArray:
    """Return the covariance (P, P) of sums in which the noise of a sample of block b counts as influence."""
    cells = _cell_sums(influence, edges, noise.cell)
    n = 1 << (2 * cells.shape[1] - 1).bit_length()
    transformed = np.fft.rfft(cells, n, axis=1)
    frequency: FloatArray = np.fft.rfftfreq(n).astype(np.float64)
    power = noise.power(frequency) * _both_sides(frequency) / n
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


def _covariances(values: FloatArray, most: int) -> FloatArray:
    """Return the autocovariances (most + 1,) of values (n,), sums divided by n."""
    n = len(values)
    transformed = np.fft.rfft(values, 1 << (2 * n - 1).bit_length())
    return np.asarray(np.fft.irfft(np.square(np.abs(transformed)))[: most + 1] / n, dtype=float)


def _autoregression(covariances: FloatArray, n: int) -> tuple[FloatArray, float]:
    """Return coefficients (order,) and innovation variance by Levinson's recursion, order by BIC."""
    best = np.empty(0), float(covariances[0])
    if not covariances[0] > 0:
        return best
    coefficients, innovation = np.empty(0), float(covariances[0])
    best_score = n * np.log(innovation)
    for order in range(1, len(covariances)):
        reflection = (covariances[order] - coefficients @ covariances[order - 1 : 0 : -1]) / innovation
        if not abs(reflection) < 1:
            break
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        innovation *= 1.0 - reflection**2
        score = n * np.log(innovation) + order * np.log(n)
        if score < best_score:
            best_score, best = score, (coefficients, innovation)
    return best
