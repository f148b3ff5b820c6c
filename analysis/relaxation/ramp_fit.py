"""The fit driven by the recorded motion: contact, ramp and hold, with nothing assumed of the ramp."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.recordings.trial import FloatArray
from analysis.relaxation.block_response import block_answer, block_rows, sampled_force
from analysis.relaxation.blocks import Blocks, condense
from analysis.relaxation.contact import Contact, find_contact
from analysis.relaxation.noise import NoiseSpectrum, estimate_covariance, measure_noise
from analysis.relaxation.projection import Rows, Solution, solve_separable
from analysis.relaxation.starting import GRID_TIMES, best_of_grid
from analysis.relaxation.windows import CannotFitError, FitWindow

_LONGEST_HOLDS = 30.0  # times are searched up to so many holds
_MOST_ARMS = 4


@dataclass(frozen=True, slots=True)
class RampSolution:
    """The fitted solid: stiffnesses (1 + n_arms,) mN/mm, k0 first; times (n_arms,) s, longest first.

    ``covariance`` is that of (k0, k1.., offset, log t1.., contact), the last only where contact was
    seen; ``jacobian`` (P, K) the model's derivatives by them over the blocks; ``squares`` the sum of
    squares weighted by samples; ``parameters`` the search's own (log times as found, contact).
    """

    stiffness_mn_per_mm: FloatArray
    times_s: FloatArray
    contact_mm: float
    contact_seen: bool
    offset_mn: float
    covariance: FloatArray
    residual_mn: FloatArray
    noise: NoiseSpectrum
    blocks: Blocks
    squares: float
    jacobian: FloatArray
    parameters: FloatArray


class RampModel:
    """The solid's rows over blocks as functions of (log times, contact): what the search moves."""

    def __init__(self, blocks: Blocks, n_arms: int, contact_mm: float, *, contact_free: bool) -> None:
        self.blocks = blocks
        self.n_arms = n_arms
        self.contact_mm = contact_mm
        self.contact_free = contact_free

    def __call__(self, parameters: FloatArray) -> Rows:
        """Return rows of depth, arms and the constant 1 (2 + n_arms, K), with their slopes."""
        times_s = np.exp(parameters[: self.n_arms])
        contact_mm = float(parameters[-1]) if self.contact_free else self.contact_mm
        answer = block_answer(self.blocks, contact_mm, times_s.tolist())
        rows = np.concatenate([answer.rows, np.ones((1, answer.rows.shape[1]))])

        def slopes(amplitudes: FloatArray) -> FloatArray:
            by_log_time = amplitudes[1:-1, None] * answer.tau_slopes * times_s[:, None]
            if not self.contact_free:
                return by_log_time
            by_contact = amplitudes[:-1] @ answer.contact_slopes
            return np.concatenate([by_log_time, by_contact[None]])

        return Rows(rows, slopes)


def fit_ramp(window: FitWindow, n_arms: int = 2, contact: Contact | None = None) -> RampSolution:
    """Fit k0, n_arms arms (1 to 4), contact point and offset to a window; CannotFitError with the reason.

    ``contact`` is where the search for the contact point begins, if that is known already.
    """
    if not 1 <= n_arms <= _MOST_ARMS:
        raise ValueError(f"a fit has 1 to {_MOST_ARMS} arms, not {n_arms}")
    contact = find_contact(window) if contact is None else contact
    blocks = condense(window, contact.sample)
    solution, contact = solve_blocks(blocks, window, contact, n_arms)
    return _finish(window, blocks, solution, contact, n_arms)


def solve_blocks(
    blocks: Blocks, window: FitWindow, contact: Contact, n_arms: int, start: FloatArray | None = None
) -> tuple[Solution, Contact]:
    """Return the solution on blocks; a contact point that leaves the recorded motion is fixed at its start.

    ``start`` gives log times and contact; without it they are looked for.
    """
    shortest_s = 2.0 * window.step_s
    longest_s = _LONGEST_HOLDS * max(window.hold_s, shortest_s)
    lowest_mm, highest_mm = float(blocks.position_mm.min()), float(blocks.position_mm.max())
    if highest_mm - lowest_mm <= 0.0:
        raise CannotFitError("the lever did not move: there is no indentation")
    known = Contact(lowest_mm - 1e-9 * max(1.0, abs(lowest_mm)), 0, contact.force_before_mn, seen=False)
    for candidate in (contact, known) if contact.seen else (known,):
        model = RampModel(blocks, n_arms, candidate.position_mm, contact_free=candidate.seen)
        if start is None or len(start) != n_arms + candidate.seen:
            log_times = _starting_times(blocks, window, candidate.position_mm, n_arms)
            begin = np.append(log_times, candidate.position_mm) if candidate.seen else log_times
        else:
            begin = start
        low = np.full(n_arms, np.log(shortest_s))
        high = np.full(n_arms, np.log(longest_s))
        if candidate.seen:
            low, high = np.append(low, lowest_mm), np.append(high, highest_mm)
        solution = solve_separable(
            model, blocks.force_mn, blocks.counts, start=begin, low=low, high=high, n_springs=1 + n_arms
        )
        if not (candidate.seen and solution.at_bound[-1]):
            return solution, candidate
    return solution, candidate


def _starting_times(blocks: Blocks, window: FitWindow, contact_mm: float, n_arms: int) -> FloatArray:
    """Return log times (n_arms,), the longest first: the best of all combinations on a grid."""
    first_s = max(8.0 * window.step_s, min(window.hold_s / 2000.0, 0.02))
    last_s = 2.0 * max(window.hold_s, 20.0 * window.step_s)
    grid_s = np.geomspace(min(first_s, last_s / 100.0), last_s, GRID_TIMES)
    rows = block_rows(blocks, contact_mm, grid_s.tolist())
    always = np.stack([rows[0], np.ones(rows.shape[1])])
    best_s = best_of_grid(rows[1:], always, blocks.force_mn, blocks.counts, grid_s=grid_s, n_times=n_arms)
    return np.log(best_s)


def _finish(
    window: FitWindow, blocks: Blocks, solution: Solution, contact: Contact, n_arms: int
) -> RampSolution:
    """Order the arms, take the residual at every sample, and the covariance from it."""
    log_times = solution.parameters[:n_arms]
    order = np.argsort(-log_times)
    stiffness = np.concatenate([solution.amplitudes[:1], solution.amplitudes[1 : 1 + n_arms][order]])
    times_s = np.exp(log_times[order])
    contact_mm = float(solution.parameters[-1]) if contact.seen else contact.position_mm
    offset_mn = float(solution.amplitudes[-1])
    force_mn = sampled_force(blocks, contact_mm, stiffness, times_s) + offset_mn
    residual_mn = window.force_mn[: len(force_mn)] - force_mn
    noise = measure_noise(residual_mn, solution.jacobian, blocks.edges)
    rows = np.concatenate([[0], 1 + order, [n_arms + 1], n_arms + 2 + order])
    if contact.seen:
        rows = np.append(rows, 2 * n_arms + 2)
    covariance = estimate_covariance(solution.jacobian[rows], blocks.edges, noise)
    return RampSolution(
        stiffness,
        times_s,
        contact_mm,
        contact.seen,
        offset_mn,
        covariance,
        residual_mn,
        noise,
        blocks,
        solution.squares,
        solution.jacobian[rows],
        solution.parameters,
    )
