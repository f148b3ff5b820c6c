"""Weighing cells by the noise of the force channel."""

from __future__ import annotations

import numpy as np
from celerite2 import driver, terms
from numpy.typing import NDArray

from analysis.mismatch.fit.noise import NoiseModel
from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]

SMALL, LONG = 1e-3, 60.0


class Whitener:
    """Turns columns over one trial's cells into columns whose noise is white with unit variance.

    The covariance of the cells is diagonal plus a sum of exponentials; its Cholesky factor is applied in
    linear time (Foreman-Mackey et al., Astron. J. 154:220, 2017, as in `celerite2`).
    """

    def __init__(self, trial: CellTrial, noise: NoiseModel) -> None:
        use = trial.fitted
        self._use = use
        self._t = np.ascontiguousarray(trial.time_s[use])
        counts = trial.counts[use]
        width_s = counts / trial.sample_rate_hz
        if not noise.parts:
            self._scale = np.sqrt(counts) / noise.white_mn
            self._factor = None
            self.log_determinant = -2.0 * float(np.log(self._scale).sum())
            return
        # the mean of a cell of width w, u = w/tau: its variance is 2 v (u - 1 + e^-u) / u^2, and two cells' covariance
        # that between their centres times sinh(u/2) / (u/2) of each
        diagonal = noise.white_mn**2 / counts
        kernel: terms.Term | None = None
        blurs = []
        for variance, tau_s in noise.parts:
            u = width_s / tau_s
            exact = 2 * variance * (u + np.expm1(-u)) / np.maximum(u, SMALL) ** 2
            diagonal = diagonal + np.where(u > SMALL, exact, variance * (1.0 - u / 3.0))
            # cells much longer than a part's time don't know of each other
            blurs.append(np.where(u < LONG, np.sinh(0.5 * np.minimum(u, LONG)) / (0.5 * u), 0.0))
            term = terms.RealTerm(a=variance, c=1.0 / tau_s)
            kernel = term if kernel is None else kernel + term
        assert kernel is not None  # there are parts
        blur = np.column_stack(blurs)
        c, _, U, V = kernel.get_celerite_matrices(self._t, diagonal)
        a, U, V = diagonal, U * blur, V * blur
        d, W = driver.factor(self._t, c, a.copy(), U, V, np.empty_like(a), np.empty_like(V))
        if np.any(d <= 0):
            raise FloatingPointError("noise covariance is not positive")
        self._factor = (c, U, W)
        self._scale = 1.0 / np.sqrt(d)
        self.log_determinant = float(np.log(d).sum())
        """ln of the determinant of the cells' noise covariance."""

    def __call__(self, columns: FloatArray) -> FloatArray:
        """Return the columns (n,) or (n, m) over the fitted cells, whitened."""
        part = columns[self._use]
        flat = part.ndim == 1
        y = np.ascontiguousarray(part[:, None] if flat else part)
        if self._factor is not None:
            c, U, W = self._factor
            y = driver.solve_lower(self._t, c, U, W, y, np.empty_like(y))
        y = y * self._scale[:, None]
        return y[:, 0] if flat else y
