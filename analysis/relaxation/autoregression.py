"""Autoregressions of a residual's means: fitted to autocovariances, and how well they say a spectrum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import FloatArray


@dataclass(frozen=True, slots=True)
class Autoregression:
    """A process x[t] = sum_k coefficients[k] x[t - 1 - k] + e[t], e of variance ``innovation``.

    ``kept`` (M,) is the share of the process that was left to see at M Fourier frequencies, evenly
    spaced over a turn; their sum is the number of values that it was fitted to.
    """

    coefficients: FloatArray
    innovation: float
    kept: FloatArray

    def power(self, frequency: FloatArray) -> FloatArray:
        """Return the power (F,), variance a value, at frequencies in cycles a value."""
        return self.innovation / np.square(np.abs(self._transfer(frequency)))

    def doubts(self, frequency: FloatArray) -> FloatArray:
        """Return what unit errors of the estimate do to log power, (F, 2 + order), one column an error.

        The errors are independent; they are those of Whittle's likelihood, in which the power at every
        frequency is known to its own size over the root of what was left to see. One coefficient more
        than was chosen is counted: the choice may have missed it.
        """
        seen = self._slopes(np.arange(len(self.kept)) / len(self.kept))
        values, vectors = np.linalg.eigh((seen.T * self.kept) @ seen / 2.0)
        errors = vectors / np.sqrt(np.maximum(values, 1e-12 * values.max()))
        return np.asarray(self._slopes(frequency) @ errors, dtype=float)

    def _slopes(self, frequency: FloatArray) -> FloatArray:
        """Return the derivatives of log power by the log of the innovation and the coefficients."""
        lags = np.arange(1, len(self.coefficients) + 2)
        waves = np.exp(-2j * np.pi * np.outer(frequency, lags))
        by_coefficient = 2.0 * np.real(waves / self._transfer(frequency)[:, None])
        return np.concatenate([np.ones((len(frequency), 1)), by_coefficient], axis=1)

    def covariances(self, n: int) -> FloatArray:
        """Return the autocovariances (n,), from the spectrum."""
        length = 1 << (4 * n - 1).bit_length()
        frequency: FloatArray = np.fft.rfftfreq(length).astype(np.float64)
        return np.asarray(np.fft.irfft(self.power(frequency))[:n], dtype=float)

    def _transfer(self, frequency: FloatArray) -> NDArray[np.complex128]:
        lags = np.arange(1, len(self.coefficients) + 1)
        waves = np.exp(-2j * np.pi * np.outer(frequency, lags))
        return np.asarray(1.0 - waves @ self.coefficients, dtype=np.complex128)


def measured_covariances(values: FloatArray, most: int) -> FloatArray:
    """Return the autocovariances (most + 1,) of values (n,), sums divided by n."""
    from scipy.fft import next_fast_len

    n = len(values)
    transformed = np.fft.rfft(values, next_fast_len(n + most, real=True))
    return np.asarray(np.fft.irfft(np.square(np.abs(transformed)))[: most + 1] / n, dtype=float)


def fit_autoregression(covariances: FloatArray, kept: FloatArray) -> Autoregression:
    """Return the autoregression of given autocovariances (most + 1,), its order chosen by BIC (Levinson).

    ``kept`` as in `Autoregression`.
    """
    best, count = Autoregression(np.empty(0), float(covariances[0]), kept), float(np.sum(kept))
    if not covariances[0] > 0:
        return best
    coefficients, innovation = np.empty(0), float(covariances[0])
    best_score = count * np.log(innovation)
    for order in range(1, len(covariances)):
        reflection = (covariances[order] - coefficients @ covariances[order - 1 : 0 : -1]) / innovation
        if not abs(reflection) < 1:
            break
        coefficients = np.append(coefficients - reflection * coefficients[::-1], reflection)
        innovation *= 1.0 - reflection**2
        score = count * np.log(innovation) + order * np.log(count)
        if score < best_score:
            best_score, best = score, Autoregression(coefficients, innovation, kept)
    return best
