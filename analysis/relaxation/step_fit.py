"""The published procedure: the hold is taken as the answer to an ideal step at the end of the ramp."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import FloatArray
from analysis.relaxation.blocks import growing_edges
from analysis.relaxation.noise import NoiseSpectrum, estimate_covariance, measure_noise
from analysis.relaxation.projection import Rows, Solution, solve_separable
from analysis.relaxation.starting import GRID_TIMES, best_of_grid
from analysis.relaxation.windows import FitWindow

_LONGEST_HOLDS = 30.0


@dataclass(frozen=True, slots=True)
class HoldBlocks:
    """Means of force over blocks of the hold; ``first_s`` (K,) of their first samples since the ramp."""

    first_s: FloatArray
    counts: FloatArray
    spacing_s: FloatArray
    force_mn: FloatArray
    edges: NDArray[np.int64]

    def until(self, stop: int) -> HoldBlocks:
        """Return the blocks that end at or before sample ``stop`` of the hold."""
        kept = int(np.searchsorted(self.edges, stop, side="right")) - 1
        return HoldBlocks(
            self.first_s[:kept],
            self.counts[:kept],
            self.spacing_s[:kept],
            self.force_mn[:kept],
            self.edges[: kept + 1],
        )


@dataclass(frozen=True, slots=True)
class StepSolution:
    """A0 and amplitudes A_i (1 + n_terms,) mN; times (n_terms,) s, longest first.

    ``covariance`` is that of (A0, A1.., log t1..), ``jacobian`` (P, K) the model's derivatives by them
    over the blocks; ``parameters`` the search's own log times; ``residual_mn`` that of the hold.
    """

    amplitudes_mn: FloatArray
    times_s: FloatArray
    covariance: FloatArray
    residual_mn: FloatArray
    noise: NoiseSpectrum
    blocks: HoldBlocks
    jacobian: FloatArray
    parameters: FloatArray
    time_at_bound: tuple[bool, ...]


def fit_step(window: FitWindow, n_terms: int = 2) -> StepSolution:
    """Fit equation (5), A0 + sum of A_i exp(-t / t_i), to the hold; CannotFitError with the reason."""
    blocks = _condense(window)
    solution = solve_hold(blocks, window, n_terms)
    order = np.argsort(-solution.parameters)
    times_s = np.exp(solution.parameters[order])
    amplitudes_mn = np.concatenate([solution.amplitudes[:1], solution.amplitudes[1:][order]])
    time_s = window.time_s[window.hold_start :] - window.time_s[window.hold_start]
    model_mn = np.full(len(time_s), amplitudes_mn[0])
    for amplitude_mn, tau_s in zip(amplitudes_mn[1:], times_s, strict=True):
        model_mn += amplitude_mn * np.exp(time_s * (-1.0 / tau_s))
    residual_mn = window.force_mn[window.hold_start :] - model_mn
    noise = measure_noise(residual_mn, solution.jacobian, blocks.edges)
    rows = np.concatenate([[0], 1 + order, 1 + n_terms + order])
    jacobian = solution.jacobian[rows]
    covariance = estimate_covariance(jacobian, blocks.edges, noise)
    return StepSolution(
        amplitudes_mn,
        times_s,
        covariance,
        residual_mn,
        noise,
        blocks,
        jacobian,
        solution.parameters,
        tuple(solution.at_bound[order].tolist()),
    )


def solve_hold(
    blocks: HoldBlocks, window: FitWindow, n_terms: int, start: FloatArray | None = None
) -> Solution:
    """Return the solution on blocks of the hold from log times ``start`` (n_terms,), or from a grid."""
    shortest_s, longest_s = 2.0 * window.step_s, _LONGEST_HOLDS * window.hold_s

    def model(log_times: FloatArray) -> Rows:
        rows, by_log_time = _decays(blocks, np.exp(log_times))

        def slopes(amplitudes: FloatArray) -> FloatArray:
            return np.asarray(amplitudes[1:, None] * by_log_time)

        return Rows(np.concatenate([np.ones((1, rows.shape[1])), rows]), slopes)

    if start is None:
        start = _starting_times(blocks, n_terms, shortest_s, window.hold_s)
    low, high = np.full(n_terms, np.log(shortest_s)), np.full(n_terms, np.log(longest_s))
    return solve_separable(
        model, blocks.force_mn, blocks.counts, start=start, low=low, high=high, n_springs=1 + n_terms
    )


def _condense(window: FitWindow) -> HoldBlocks:
    time_s = window.time_s[window.hold_start :] - window.time_s[window.hold_start]
    force_mn = window.force_mn[window.hold_start :]
    if not window.even:
        ones = np.ones(len(time_s))
        edges = np.arange(len(time_s) + 1)
        return HoldBlocks(time_s, ones, ones * window.step_s, force_mn, edges)
    edges = np.append(growing_edges(0, len(force_mn)), len(force_mn))
    counts = np.diff(edges).astype(float)
    means = np.add.reduceat(force_mn, edges[:-1]) / counts
    return HoldBlocks(time_s[edges[:-1]], counts, np.full(len(counts), window.step_s), means, edges)


def _decays(blocks: HoldBlocks, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return block means of exp(-t / tau) and their derivatives by log tau, (n_terms, K) each."""
    ratio = blocks.spacing_s / times_s[:, None]
    age = blocks.first_s / times_s[:, None]
    n = blocks.counts
    one, many = -np.expm1(-ratio), -np.expm1(-n * ratio)
    means = np.exp(-age) * many / one / n
    by_ratio = (n * (1.0 - many) * one - many * (1.0 - one)) / one**2
    return means, means * age - np.exp(-age) * by_ratio * ratio / n


def _starting_times(blocks: HoldBlocks, n_terms: int, shortest_s: float, hold_s: float) -> FloatArray:
    last_s = 2.0 * hold_s
    grid = np.geomspace(max(min(hold_s / 500.0, last_s), 2.0 * shortest_s), last_s, GRID_TIMES)
    rows, _ = _decays(blocks, grid)
    constant = np.ones((1, rows.shape[1]))
    return np.log(best_of_grid(rows, constant, blocks.force_mn, blocks.counts, grid_s=grid, n_times=n_terms))
