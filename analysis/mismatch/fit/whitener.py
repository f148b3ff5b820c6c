"""Weighing cells by the noise of the force channel."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from celerite2 import driver
from numpy.typing import NDArray

from analysis.mismatch.fit.noise import NoiseModel
from analysis.mismatch.fit.semiseparable import (
    factored,
    lasting,
    remembered,
    solve_fours,
    solve_many,
    solve_one,
    solve_transposed,
    surprise,
)
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


class Whitener:
    """Turns columns over one trial's cells into columns whose noise is white with unit variance.

    The covariance of the cells is diagonal plus a sum of exponentials; its Cholesky factor is found and applied in
    linear time (`semiseparable`). The exponentials between cells are the same for all columns ever whitened.
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
        by_position = [(f[use, None], np.array([lasts_s])) for f, lasts_s in trial.by_position]
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
        terms = [*((r.force_mn[self._use], r.waves_coherent_s) for r in self._rhythms), *by_position]
        for f, _ in terms:
            diagonal = diagonal + np.einsum("ij,ij->i", f, f)
        U, V = (np.hstack([of, *(f for f, _ in terms)]) for of in (U, V))
        tau_s = np.concatenate([tau_s, *(of_them_s for _, of_them_s in terms)])
        decay = _decay(trial.steps if use.all() else Steps.between(trial.time_s[use]), tau_s)
        d, W = factored(decay, diagonal, U, V)
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
                solve_one(*self._factor, y)
            return np.asarray(y * self._scale)
        if self._factor is not None:
            (solve_fours if y.shape[1] < MANY else solve_many)(*self._factor, y)
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
        z = self(residual_mn) * self._scale
        solve_transposed(*self._factor, z)
        pull = np.zeros((len(residual_mn), 1))
        pull[self._use, 0] = z
        return [remembered(decay_of(self._trial, r), r.force_mn * pull) for r in self._rhythms]

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


def surprise_of(trial: CellTrial, rhythm: Rhythm) -> float:
    """Return the chi2 of a rhythm's amplitudes as they were found against what they are beforehand."""
    return float(surprise(decay_of(trial, rhythm), rhythm.amplitudes))


def _drawn_amplitudes(trial: CellTrial, rhythm: Rhythm, random: np.random.Generator) -> FloatArray:
    """Return amplitudes (n, K) of a rhythm as they are distributed before a trial is seen."""
    decay = decay_of(trial, rhythm)
    anew = np.sqrt(np.vstack([np.ones((1, decay.shape[1])), 1.0 - decay**2]))
    return np.asarray(lasting(decay, anew * random.standard_normal(rhythm.force_mn.shape)))


def decay_of(trial: CellTrial, rhythm: Rhythm) -> FloatArray:
    """Return what of each of a rhythm's amplitudes lasts from cell to cell (n - 1, K)."""
    return _decay(trial.steps, rhythm.waves_coherent_s)


def _decay(steps: Steps, lasts_s: FloatArray) -> FloatArray:
    """Return what lasts from point to point (n - 1, K), of few lengths."""
    return np.take(np.exp(-steps.lengths_s[:, None] / lasts_s), steps.index, axis=0)
