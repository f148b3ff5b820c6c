"""Weighing cells by the noise of the force channel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from celerite2 import driver
from numba import njit
from numpy.typing import NDArray

from analysis.mismatch.fit.noise import NoiseModel
from analysis.mismatch.model.rhythm import Rhythm
from analysis.simulation.cells import CellTrial
from analysis.simulation.response import Steps
from analysis.simulation.samples import kept_by_mean

FloatArray = NDArray[np.float64]

LONG = 60.0
SHOWS = 0.1
"""Share of a cell's white noise from which that of the position counts beside it."""
MANY = 12
"""From so many columns on all are solved side by side sooner than four by four."""


@njit(cache=True, fastmath=True)
def _solve_one(decay: FloatArray, U: FloatArray, W: FloatArray, z: FloatArray) -> None:
    """Solve L x = z in place for one column (n,). What the last but one did is summed while the last is waited for."""
    n, J = U.shape
    F = np.zeros(J)
    last = z[0]
    for i in range(1, n):
        earlier, of_last = 0.0, 0.0
        for j in range(J):
            p, w = decay[i - 1, j], W[i - 1, j]
            u = U[i, j] * p
            earlier += u * F[j]
            of_last += u * w
            F[j] = p * (F[j] + w * last)
        last = z[i] - earlier - of_last * last
        z[i] = last


@njit(cache=True, fastmath=True)
def _solve_fours(decay: FloatArray, U: FloatArray, W: FloatArray, Z: FloatArray) -> None:
    """Solve L X = Z in place, four columns at a time in registers."""
    n, J = U.shape
    m = Z.shape[1]
    F = np.empty((4, J))
    for a in range(0, m, 4):
        # of fewer than four the last is solved several times
        b, c, d = min(a + 1, m - 1), min(a + 2, m - 1), min(a + 3, m - 1)
        of_a, of_b, of_c, of_d = Z[0, a], Z[0, b], Z[0, c], Z[0, d]
        F[:] = 0.0
        for i in range(1, n):
            left_a, left_b, left_c, left_d = Z[i, a], Z[i, b], Z[i, c], Z[i, d]
            for j in range(J):
                p, w, u = decay[i - 1, j], W[i - 1, j], U[i, j]
                F[0, j] = p * (F[0, j] + w * of_a)
                F[1, j] = p * (F[1, j] + w * of_b)
                F[2, j] = p * (F[2, j] + w * of_c)
                F[3, j] = p * (F[3, j] + w * of_d)
                left_a -= u * F[0, j]
                left_b -= u * F[1, j]
                left_c -= u * F[2, j]
                left_d -= u * F[3, j]
            of_a, of_b, of_c, of_d = left_a, left_b, left_c, left_d
            Z[i, a], Z[i, b], Z[i, c], Z[i, d] = of_a, of_b, of_c, of_d


@njit(cache=True, fastmath=True)
def _solve_many(decay: FloatArray, U: FloatArray, W: FloatArray, Z: FloatArray) -> None:
    """Solve L X = Z in place, all columns side by side."""
    n, J = U.shape
    m = Z.shape[1]
    F = np.zeros((J, m))
    for i in range(1, n):
        for j in range(J):
            p, w, u = decay[i - 1, j], W[i - 1, j], U[i, j]
            for k in range(m):
                F[j, k] = p * (F[j, k] + w * Z[i - 1, k])
                Z[i, k] -= u * F[j, k]


@njit(cache=True, fastmath=True)
def _factored(
    decay: FloatArray, diagonal: FloatArray, U: FloatArray, V: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return d (n,) and W (n, J) of the factors L diag(d) L' of a covariance, L of U, W and decay below its diagonal.

    As `celerite2.driver.factor`, with the decay in steps given.
    """
    n, J = U.shape
    d, W = np.empty(n), np.empty((n, J))
    S, p, w, u = np.zeros((J, J)), np.empty(J), np.empty(J), np.empty(J)
    d[0] = diagonal[0]
    W[0] = V[0] / d[0]
    for i in range(1, n):
        # nearer than in rows of the whole, all of them are read J times
        for j in range(J):
            p[j], w[j], u[j] = decay[i - 1, j], W[i - 1, j], U[i, j]
        left = diagonal[i]
        for j in range(J):
            new, known = d[i - 1] * w[j], 0.0
            for k in range(J):
                S[j, k] = p[j] * p[k] * (S[j, k] + new * w[k])
                known += u[k] * S[j, k]
            W[i, j] = V[i, j] - known
            left -= u[j] * known
        d[i] = left
        for j in range(J):
            W[i, j] /= left
    return d, W


class Whitener:
    """Turns columns over one trial's cells into columns whose noise is white with unit variance.

    The covariance of the cells is diagonal plus a sum of exponentials; its Cholesky factor is found and applied in
    linear time (Foreman-Mackey et al., Astron. J. 154:220, 2017). Most of a diagnosis is that: it is done here, in a
    third of the time of `celerite2`, which does what is asked for less often. The exponentials between cells are the
    same for all columns ever whitened.
    A rhythm's covariance is a sum of such terms too, f_k(t) f_k(t') exp(-|t - t'|/T) of its force columns f_k; so is
    that of the simulated force for the noise that the smoothed position still has.
    """

    def __init__(self, trial: CellTrial, noise: NoiseModel, rhythms: Sequence[Rhythm] = ()) -> None:
        use = trial.fitted
        self._use = slice(None) if use.all() else use
        self._trial, self._noise, self._rhythms = trial, noise, tuple(rhythms)
        self._time_s = np.ascontiguousarray(trial.time_s)
        counts = trial.counts[use] if trial.louder is None else (trial.counts / trial.louder**2)[use]
        exponentials = noise.exponentials
        white = noise.white_mn**2 / counts
        by_position = [(f[use, None], lasts_s) for f, lasts_s in trial.by_position]
        by_position = [term for term in by_position if np.any(term[0][:, 0] ** 2 > SHOWS * white)]
        if not exponentials and not noise.bands and not rhythms and not by_position:
            self._scale = np.sqrt(counts) / noise.white_mn
            self._factor = None
            self.log_determinant = -2.0 * float(np.log(self._scale).sum())
            return
        # of cells of width w, u = w/tau, the means' covariance is that between their centres times sinh(u/2) / (u/2) of
        # each
        variance, tau_s = np.array(exponentials).reshape(-1, 2).T
        # cells come in few lengths, and so do the times between them
        widths_s, of_cell = trial.fitted_widths_s
        u = widths_s[:, None] / tau_s
        diagonal = white + (kept_by_mean(u) @ variance)[of_cell]
        # cells much longer than a part's time don't know of each other
        blur = np.where(u < LONG, np.sinh(0.5 * np.minimum(u, LONG)) / (0.5 * u), 0.0)[of_cell]
        U, V = variance * blur, blur
        for v, frequency_hz, lasts_s in noise.bands:
            swaying = widths_s * (1.0 / lasts_s + 2j * np.pi * frequency_hz)
            diagonal = diagonal + v * np.real(kept_by_mean(swaying))[of_cell]
            capped = np.minimum(swaying.real, LONG) + 1j * swaying.imag
            mean = np.where(swaying.real < LONG, np.sinh(0.5 * capped) / (0.5 * swaying), 0.0)[of_cell]
            turn = np.exp(2j * np.pi * frequency_hz * trial.time_s[use])
            # cos(a - b) of the phases of two cells, each turned by what its mean does to it
            a, b = (turn * np.conj(mean), turn * mean)
            U, V = np.column_stack([U, v * a.real, v * a.imag]), np.column_stack([V, b.real, b.imag])
            tau_s = np.append(tau_s, [lasts_s, lasts_s])
        for rhythm in self._rhythms:
            f = rhythm.force_mn[self._use]
            diagonal = diagonal + np.sum(f**2, axis=1)
            U, V = np.hstack([U, f]), np.hstack([V, f])
            tau_s = np.append(tau_s, rhythm.waves_coherent_s)
        for f, lasts_s in by_position:
            diagonal = diagonal + f[:, 0] ** 2
            U, V, tau_s = np.hstack([U, f]), np.hstack([V, f]), np.append(tau_s, lasts_s)
        steps = trial.steps if use.all() else Steps.between(trial.time_s[use])
        decay = np.exp(-steps.lengths_s[:, None] / tau_s)[steps.index]
        d, W = _factored(decay, diagonal, U, V)
        if not np.all(d > 0):
            raise FloatingPointError("noise covariance is not positive")
        self._factor = (decay, U, W)
        self._rates_hz = 1.0 / tau_s
        self._scale = 1.0 / np.sqrt(d)
        self.log_determinant = float(np.log(d).sum())
        """ln of the determinant of the cells' noise covariance."""

    def __call__(self, columns: FloatArray) -> FloatArray:
        """Return the columns (n,) or (n, m) over the fitted cells, whitened."""
        flat = columns.ndim == 1
        y = np.array(columns[self._use], order="C")
        if flat:
            if self._factor is not None:
                _solve_one(*self._factor, y)
            return np.asarray(y * self._scale)
        if self._factor is not None:
            (_solve_fours if y.shape[1] < MANY else _solve_many)(*self._factor, y)
        y *= self._scale[:, None]
        return y

    def with_rhythms(self, rhythms: Sequence[Rhythm]) -> Whitener:
        """Return what weighs by the same noise beside other rhythms."""
        return Whitener(self._trial, self._noise, rhythms) if rhythms else self._alone

    @cached_property
    def _alone(self) -> Whitener:
        return Whitener(self._trial, self._noise)

    def amplitudes(self, residual_mn: FloatArray) -> list[FloatArray]:
        """Return each rhythm's likeliest amplitudes (n, K) in all that a simulation leaves (n,)."""
        if not self._rhythms or self._factor is None:
            return []
        z = (self(residual_mn) * self._scale)[:, None]
        t = self._time_s[self._use]
        driver.solve_upper(t, self._rates_hz, self._factor[1], self._factor[2], z, z)
        pull = np.zeros((len(residual_mn), 1))
        pull[self._use] = z
        found = []
        for rhythm in self._rhythms:
            y = rhythm.force_mn * pull
            before, after = (
                _remembered(self._time_s, rhythm, y, of) for of in (driver.matmul_lower, driver.matmul_upper)
            )
            found.append(y + before + after)
        return found

    def left_open(self, random: np.random.Generator) -> list[FloatArray]:
        """Return a draw (n, K) of how far each rhythm's amplitudes may be from the likeliest ones.

        What drawn rhythms differ by from what is found of them in their sum with drawn noise is distributed as what the
        true ones differ by (Matheron's rule; Hoffman and Ribak, Astrophys. J. 380:L5, 1991).
        """
        amplitudes = [_drawn_amplitudes(self._trial, r, random) for r in self._rhythms]
        force_mn = np.zeros(len(self._time_s))
        force_mn[self._use] = self._alone.drawn(random)
        for rhythm, of_it in zip(self._rhythms, amplitudes, strict=True):
            force_mn += rhythm.line_mn(of_it)
        return [a - found for a, found in zip(amplitudes, self.amplitudes(force_mn), strict=True)]

    def drawn(self, random: np.random.Generator) -> FloatArray:
        """Return noise of this covariance (n,) over the fitted cells, mN."""
        y = random.standard_normal((len(self._scale), 1)) / self._scale[:, None]
        if self._factor is not None:
            _, U, W = self._factor
            driver.matmul_lower(self._time_s[self._use], self._rates_hz, U, W, y.copy(), y)
        return y[:, 0]


def surprise(trial: CellTrial, rhythm: Rhythm) -> float:
    """Return the chi2 of a rhythm's amplitudes as they were found against what they are beforehand."""
    decay, d = _innovations(trial, rhythm)
    z = rhythm.amplitudes.copy()
    z[1:] -= decay * rhythm.amplitudes[:-1]
    return float(np.sum(z**2 / d))


def _drawn_amplitudes(trial: CellTrial, rhythm: Rhythm, random: np.random.Generator) -> FloatArray:
    """Return amplitudes (n, K) of a rhythm as they are distributed before a trial is seen."""
    _, d = _innovations(trial, rhythm)
    y = np.sqrt(d) * random.standard_normal(rhythm.force_mn.shape)
    return y + _remembered(np.ascontiguousarray(trial.time_s), rhythm, y, driver.matmul_lower)


def _innovations(trial: CellTrial, rhythm: Rhythm) -> tuple[FloatArray, FloatArray]:
    """Return what of each amplitude lasts from cell to cell (n - 1, K), and the variance (n, K) of what is new."""
    decay = np.exp(-np.diff(trial.time_s)[:, None] / rhythm.waves_coherent_s)
    return decay, np.vstack([np.ones((1, decay.shape[1])), 1.0 - decay**2])


def _remembered(time_s: FloatArray, rhythm: Rhythm, y: FloatArray, of: Callable[..., object]) -> FloatArray:
    """Return what each amplitude (n, K) remembers of the cells before or after it, ``of`` celerite2's driver."""
    one, found = np.ones((len(y), 1)), np.zeros_like(y)
    of_waves_s = rhythm.waves_coherent_s
    for coherent_s in np.unique(of_waves_s):
        waves = of_waves_s == coherent_s
        of_them = np.zeros((len(y), np.count_nonzero(waves)))
        of(time_s, np.array([1.0 / coherent_s]), one, one, np.ascontiguousarray(y[:, waves]), of_them)
        found[:, waves] = of_them
    return found
