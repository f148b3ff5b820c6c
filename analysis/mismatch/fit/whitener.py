"""Weighing cells by the noise of the force channel."""

from __future__ import annotations

import numpy as np
from celerite2 import driver
from numba import njit
from numpy.typing import NDArray

from analysis.mismatch.fit.noise import NoiseModel
from analysis.simulation.cells import CellTrial
from analysis.simulation.response import Steps

FloatArray = NDArray[np.float64]

SMALL, LONG = 1e-3, 60.0


@njit(cache=True, fastmath=True)
def _solve_lower(decay: FloatArray, U: FloatArray, W: FloatArray, Z: FloatArray) -> None:
    n, J = U.shape
    m = Z.shape[1]
    F = np.zeros((J, m))
    if m == 1:
        for i in range(1, n):
            before, left = Z[i - 1, 0], 0.0
            for j in range(J):
                F[j, 0] = decay[i - 1, j] * (F[j, 0] + W[i - 1, j] * before)
                left += U[i, j] * F[j, 0]
            Z[i, 0] -= left
        return
    for i in range(1, n):
        for j in range(J):
            p, w, u = decay[i - 1, j], W[i - 1, j], U[i, j]
            for k in range(m):
                F[j, k] = p * (F[j, k] + w * Z[i - 1, k])
                Z[i, k] -= u * F[j, k]


class Whitener:
    """Turns columns over one trial's cells into columns whose noise is white with unit variance.

    The covariance of the cells is diagonal plus a sum of exponentials; its Cholesky factor is found and applied in
    linear time (Foreman-Mackey et al., Astron. J. 154:220, 2017). `celerite2` finds it. It is applied here, in less
    than half of `celerite2`'s time: the exponentials between cells are the same for all columns ever whitened.
    """

    def __init__(self, trial: CellTrial, noise: NoiseModel) -> None:
        use = trial.fitted
        self._use = slice(None) if use.all() else use
        counts = trial.counts[use]
        if not noise.parts:
            self._scale = np.sqrt(counts) / noise.white_mn
            self._factor = None
            self.log_determinant = -2.0 * float(np.log(self._scale).sum())
            return
        # the mean of a cell of width w, u = w/tau: its variance is 2 v (u - 1 + e^-u) / u^2, and two cells' covariance
        # that between their centres times sinh(u/2) / (u/2) of each
        variance, tau_s = (np.array(values) for values in zip(*noise.parts, strict=True))
        # cells come in few lengths, and so do the times between them
        widths_s, of_cell = trial.fitted_widths_s
        u = widths_s[:, None] / tau_s
        exact = 2 * variance * (u + np.expm1(-u)) / np.maximum(u, SMALL) ** 2
        of_parts = np.where(u > SMALL, exact, variance * (1.0 - u / 3.0))
        diagonal = noise.white_mn**2 / counts + of_parts.sum(axis=1)[of_cell]
        # cells much longer than a part's time don't know of each other
        blur = np.where(u < LONG, np.sinh(0.5 * np.minimum(u, LONG)) / (0.5 * u), 0.0)[of_cell]
        steps = trial.steps if use.all() else Steps.between(trial.time_s[use])
        t = np.ascontiguousarray(trial.time_s[use])
        U = variance * blur
        d, W = driver.factor(t, 1.0 / tau_s, diagonal, U, blur, np.empty_like(diagonal), np.empty_like(blur))
        if np.any(d <= 0):
            raise FloatingPointError("noise covariance is not positive")
        self._factor = (np.exp(-steps.lengths_s[:, None] / tau_s)[steps.index], U, W)
        self._scale = 1.0 / np.sqrt(d)
        self.log_determinant = float(np.log(d).sum())
        """ln of the determinant of the cells' noise covariance."""

    def __call__(self, columns: FloatArray) -> FloatArray:
        """Return the columns (n,) or (n, m) over the fitted cells, whitened."""
        flat = columns.ndim == 1
        y = np.array((columns[:, None] if flat else columns)[self._use], order="C")
        if self._factor is not None:
            _solve_lower(*self._factor, y)
        y *= self._scale[:, None]
        return y[:, 0] if flat else y
