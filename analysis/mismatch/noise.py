"""The noise of a force channel, and how to weigh cells by it.

The noise model only decides how well evidence is gathered; no significance rests on it (that is left to
sign-flips over trials).
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from celerite2 import driver, terms
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.signal import welch

from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]

CORRELATION_TIMES_S = (4e-4, 1.6e-3, 6.4e-3, 0.0256, 0.1024, 0.41, 1.6)
TIMES_A_SEGMENT = 3.9
SEGMENT_S = 1.6
# A weak slow part is more likely a slow effect that has not been named yet; weighing it down would hide it. Leaving out
# a part that is real costs some power and no validity, since significance trusts no noise model.
SLOW_S = 0.05
SLOW_MUST_EXCEED = 60.0
QUICK_MUST_EXCEED = 0.3


@dataclass(frozen=True, slots=True)
class NoiseModel:
    """White noise of ``white_mn`` rms a sample, plus Ornstein-Uhlenbeck parts (variance mN^2, time s)."""

    white_mn: float
    parts: tuple[tuple[float, float], ...] = ()

    @property
    def rms_mn(self) -> float:
        """Rms of a single sample, mN."""
        return float(np.sqrt(self.white_mn**2 + sum(v for v, _ in self.parts)))

    def power(self, frequency_hz: FloatArray, sample_rate_hz: float) -> FloatArray:
        """Return the one-sided power spectrum (F,) in mN^2/Hz."""
        white = np.full_like(frequency_hz, 2.0 * self.white_mn**2 / sample_rate_hz)
        return white + sum(4.0 * v * t / (1.0 + (2 * np.pi * frequency_hz * t) ** 2) for v, t in self.parts)


@dataclass(frozen=True)
class Loose:
    """What a trial deviates by: orthonormal directions U (n, q) of its whitened cells, their sizes s (q,).

    ``columns_mn`` (N, q): the same deviations over all cells, one for each direction, in units of their size.
    """

    directions: FloatArray
    sizes: FloatArray
    columns_mn: FloatArray

    @staticmethod
    def along(whitened: FloatArray, columns_mn: FloatArray) -> Loose:
        """Return the deviations along columns of unit variance."""
        u, s, vt = np.linalg.svd(whitened, full_matrices=False)
        return Loose(u, s, columns_mn @ vt.T)

    def shrunk(self, whitened: FloatArray) -> FloatArray:
        """Return (1 + B B')^-1/2 y for whitened columns y (n, m)."""
        shrink = 1.0 - 1.0 / np.sqrt(1.0 + self.sizes**2)
        return whitened - self.directions @ (shrink[:, None] * (self.directions.T @ whitened))

    def expected(self, whitened: FloatArray) -> FloatArray:
        """Return the expected deviation (N,) mN, given a whitened residual (n,)."""
        return self.columns_mn @ (self.sizes / (1.0 + self.sizes**2) * (self.directions.T @ whitened))


class Whitener:
    """Turns columns over one trial's cells into columns whose noise is white with unit variance.

    The covariance of the cells is diagonal plus a sum of exponentials; its Cholesky factor is applied in
    linear time (Foreman-Mackey et al., Astron. J. 154:220, 2017, as in `celerite2`).
    """

    def __init__(self, trial: CellTrial, noise: NoiseModel) -> None:
        use = trial.fitted
        self._use = use
        self._loose: Loose | None = None
        self._t = np.ascontiguousarray(trial.time_s[use])
        counts = trial.counts[use]
        width_s = counts / trial.sample_rate_hz
        if not noise.parts:
            self._scale = np.sqrt(counts) / noise.white_mn
            self._factor = None
            return
        diagonal = noise.white_mn**2 / counts
        shrink = np.zeros_like(diagonal)
        kernel: terms.Term | None = None
        for variance, tau_s in noise.parts:
            # averaging over a cell leaves less of a quick part: var(mean) = 2 v (u - 1 + e^-u) / u^2
            u = width_s / tau_s
            mean_variance = np.where(
                u > 1e-3, 2 * variance * (u + np.expm1(-u)) / np.maximum(u, 1e-3) ** 2, variance
            )
            quick = u > 1.0
            shrink += np.where(quick, mean_variance - variance, 0.0)
            term = terms.RealTerm(a=variance, c=1.0 / tau_s)
            kernel = term if kernel is None else kernel + term
        # a part quicker than the cell is white from cell to cell; celerite's own share of it is taken back
        diagonal = np.maximum(diagonal + shrink, 1e-3 * diagonal)
        assert kernel is not None  # there are parts
        c, a, U, V = kernel.get_celerite_matrices(self._t, diagonal)
        d, W = driver.factor(self._t, c, a.copy(), U, V, np.empty_like(a), np.empty_like(V))
        if np.any(d <= 0):
            raise FloatingPointError("noise covariance is not positive")
        self._factor = (c, U, W)
        self._scale = 1.0 / np.sqrt(d)

    @property
    def scale(self) -> FloatArray:
        """What each fitted cell is multiplied by (n,), 1/mN: the inverse of its noise, given the cells before it."""
        return self._scale

    @property
    def tight(self) -> Whitener:
        """The same noise without what the trial may deviate by."""
        if self._loose is None:
            return self
        found = copy(self)
        found._loose = None
        return found

    def loosened(self, columns_mn: FloatArray) -> Whitener:
        """Return a whitener to which a trial also deviates by ``columns_mn`` (n, q), each of unit variance.

        The covariance of the whitened cells gains B B', B the whitened columns; (1 + B B')^-1/2 is applied to them.
        """
        found = copy(self)
        found._loose = Loose.along(self.tight(columns_mn), columns_mn)
        return found

    def settled(self, residual_mn: FloatArray) -> FloatArray:
        """Return a residual (n,) mN less what the trial deviates by, by its expectation given the residual."""
        if self._loose is None:
            return residual_mn
        return residual_mn - self._loose.expected(self.tight(residual_mn))

    def __call__(self, columns: FloatArray) -> FloatArray:
        """Return the columns (n,) or (n, m) over the fitted cells, whitened."""
        part = columns[self._use]
        flat = part.ndim == 1
        y = np.ascontiguousarray(part[:, None] if flat else part)
        if self._factor is not None:
            c, U, W = self._factor
            y = driver.solve_lower(self._t, c, U, W, y, np.empty_like(y))
        y = y * self._scale[:, None]
        if self._loose is not None:
            y = self._loose.shrunk(y)
        return y[:, 0] if flat else y


def measure_noise(
    residuals: Sequence[FloatArray], sample_rate_hz: float, segment_s: float = SEGMENT_S
) -> NoiseModel:
    """Return the noise model that fits the power spectrum of quiet stretches of residual (each (n_i,), mN).

    The spectrum's median over logarithmic bands is fitted, so that single lines (hum, pulse) do not count as noise,
    and each stretch's median over segments, so that one step in it does not. Segments are no longer than the shortest
    stretch: a mismatch not named yet is slow, and would pass for noise in long ones; nor than ``segment_s``, which
    must hold a few correlation times of the slowest part.
    """
    length = min(round(segment_s * sample_rate_hz), max(16, min(len(r) for r in residuals)))
    spectra = [
        # the stubs know the kind of detrending as "literal"
        welch(r, sample_rate_hz, nperseg=length, detrend="linear", average="median")[1]  # type: ignore[call-overload]
        for r in residuals
        if len(r) >= length
    ]
    frequency = np.fft.rfftfreq(length, 1.0 / sample_rate_hz)
    power = np.mean(spectra, axis=0)
    edges = np.unique(np.round(np.geomspace(1.5, len(frequency) - 1, 40)).astype(int))
    bands = [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True) if b > a]
    # the median of the mean of k exponentials lies below its mean; k segments are enough to ignore that
    p = np.array([np.median(power[b]) for b in bands])
    f = np.array([np.mean(frequency[b]) for b in bands])
    p = np.maximum(p, 1e-12 * p.max())
    taus = [t for t in CORRELATION_TIMES_S if 2.0 / sample_rate_hz < t <= segment_s / TIMES_A_SEGMENT]
    shapes = [NoiseModel(1.0).power(f, sample_rate_hz)]
    shapes += [NoiseModel(0.0, ((1.0, t),)).power(f, sample_rate_hz) for t in taus]
    basis = np.column_stack(shapes)
    weight = 1.0 / p
    share = np.zeros(basis.shape[1])
    for _ in range(6):
        weighed = basis * weight[:, None]
        # parts of very different size stall the search for their shares
        size = np.linalg.norm(weighed, axis=0)
        share = nnls(weighed / size, p * weight)[0] / size
        weight = 1.0 / np.maximum(basis @ share, 0.7 * p)
    white = max(float(share[0]), 1e-3 * float(np.median(p)) * sample_rate_hz / 2.0)
    parts = tuple(
        (float(v), t)
        for v, t in zip(share[1:], taus, strict=True)
        if 4.0 * v * t
        > (SLOW_MUST_EXCEED if t > SLOW_S else QUICK_MUST_EXCEED) * 2.0 * white / sample_rate_hz
    )
    return NoiseModel(float(np.sqrt(white)), parts)
