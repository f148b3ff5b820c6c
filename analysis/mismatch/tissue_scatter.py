"""How much the tissue differs from trial to trial, as far as the residuals tell it from noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Scatter:
    """Scatter of the shared parameters over trials.

    ``spread`` (P, K): K independent deviations of unit variance times these columns make up a trial's, on the scale
    of the fit. ``gain``: by how much such a scatter improves on one tissue for all, twice the logarithm of the
    likelihood.
    """

    spread: FloatArray
    gain: float

    @staticmethod
    def none(n_parameters: int) -> Scatter:
        """Return no scatter: one tissue for all trials."""
        return Scatter(np.zeros((n_parameters, 0)), 0.0)


def scatter_over(residuals: Sequence[FloatArray], columns: Sequence[FloatArray]) -> Scatter:
    """Measure the scatter from whitened residuals (n_j,) and derivatives by the shared parameters (n_j, P), by trial.

    In coordinates in which the mean information is the unit matrix, noise alone gives the trials' gradients unit
    variance in every direction; a direction in which they have more than the largest variance that T trials of P
    parameters show by chance (1 + sqrt(P / T))^2 (Marchenko, Pastur 1967) scatters by the excess.
    """
    n = len(residuals)
    p = columns[0].shape[1] if n else 0
    if n < 2 or not p:
        return Scatter.none(p)
    mean = np.mean([J.T @ J for J in columns], axis=0)
    scale = np.sqrt(np.maximum(np.diag(mean), 1e-300))
    size, turn = np.linalg.eigh(mean / np.outer(scale, scale))
    seen = size > 1e-9 * size[-1]
    to_unit = turn[:, seen] / np.sqrt(size[seen]) / scale[:, None]
    gradients = np.array([to_unit.T @ (J.T @ r) for r, J in zip(residuals, columns, strict=True)])
    variance, directions = np.linalg.eigh(gradients.T @ gradients / (n - 1))
    much = variance > (1.0 + np.sqrt(gradients.shape[1] / n)) ** 2
    spread = to_unit @ directions[:, much] * np.sqrt(variance[much] - 1.0)
    gain = float(n * np.sum(variance[much] - 1.0 - np.log(variance[much])))
    return Scatter(spread, gain)
