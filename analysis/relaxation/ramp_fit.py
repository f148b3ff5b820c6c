"""The fit driven by the recorded motion: contact, ramp and hold, with nothing assumed of the ramp."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analysis.recordings.trial import FloatArray
from analysis.relaxation.block_response import block_answer, block_rows, sampled_force
from analysis.relaxation.blocks import Blocks, condense
from analysis.relaxation.contact import Contact, find_contact
from analysis.relaxation.contact_law import FLAT, HIGHEST, LOWEST, ContactLaw
from analysis.relaxation.convex_response import convex_answer, law_knots
from analysis.relaxation.flatness import Flatness, ask_flatness
from analysis.relaxation.noise import (
    NoiseSpectrum,
    influences,
    measure_noise,
    neighbouring_noise,
    noise_covariance,
    widened,
)
from analysis.relaxation.projection import Rows, Solution, solve_separable
from analysis.relaxation.result import Estimate
from analysis.relaxation.starting import GRID_TIMES, best_of_grid
from analysis.relaxation.windows import CannotFitError, FitWindow

_LONGEST_HOLDS = 30.0  # times are searched up to so many holds
_MOST_ARMS = 4
_CONVEX_SIGMAS = 3.0  # by which an exponent must differ from 1 before a flat punch is given up
_CONVEX_STARTS = (1.5, 2.0)  # a sphere, a cone


@dataclass(frozen=True, slots=True)
class RampSolution:
    """The fitted solid: stiffnesses (1 + n_arms,) mN/mm, k0 first; times (n_arms,) s, longest first.

    ``covariance`` is that of (k0, k1.., offset, log t1.., contact, exponent), the last two only where they
    were free; ``jacobian`` (P, K) the model's derivatives by them over the blocks; ``squares`` the sum of
    squares weighted by samples; ``parameters`` the search's own (log times as found, contact, exponent).
    ``doubted`` is the noise where only what differs between neighbours counts; ``time_at_bound`` (n_arms,)
    says which times stopped at a bound. ``law`` is the contact law of the fit, ``exponent`` what the loading
    says of it, None where it says nothing (or was not asked); ``flat`` is False where the residual of a flat
    fit may be that of a convex punch.
    """

    stiffness_mn_per_mm: FloatArray
    times_s: FloatArray
    contact_mm: float
    contact_seen: bool
    offset_mn: float
    covariance: FloatArray
    residual_mn: FloatArray
    noise: NoiseSpectrum
    doubted: NoiseSpectrum
    blocks: Blocks
    squares: float
    jacobian: FloatArray
    parameters: FloatArray
    time_at_bound: tuple[bool, ...]
    law: ContactLaw = FLAT
    exponent_free: bool = False
    exponent: Estimate | None = None
    flat: bool = True


@dataclass(frozen=True, slots=True)
class RampModel:
    """The solid's rows over blocks as functions of (log times, contact, exponent): what the search moves."""

    blocks: Blocks
    n_arms: int
    contact_mm: float
    contact_free: bool
    law: ContactLaw = FLAT
    exponent_free: bool = False

    def law_at(self, parameters: FloatArray) -> ContactLaw:
        """Return the contact law that these parameters say."""
        if not self.exponent_free:
            return self.law
        return ContactLaw(float(parameters[-1]), self.law.reference_mm)

    def contact_at(self, parameters: FloatArray) -> float:
        """Return the contact point that these parameters say, mm."""
        return float(parameters[self.n_arms]) if self.contact_free else self.contact_mm

    def __call__(self, parameters: FloatArray) -> Rows:
        """Return rows of depth, arms and the constant 1 (2 + n_arms, K), with their slopes."""
        times_s = np.exp(parameters[: self.n_arms])
        contact_mm = self.contact_at(parameters)
        by_exponent: FloatArray | None = None
        if self.law.exponent == 1.0 and not self.exponent_free:
            flat = block_answer(self.blocks, contact_mm, times_s.tolist())
            rows, by_tau, by_contact = flat.rows, flat.tau_slopes, flat.contact_slopes
        else:
            convex = convex_answer(self.blocks, contact_mm, times_s.tolist(), self.law_at(parameters))
            rows, by_tau, by_contact = convex.rows, convex.tau_slopes, convex.contact_slopes
            by_exponent = convex.exponent_slopes

        def slopes(amplitudes: FloatArray) -> FloatArray:
            springs = amplitudes[:-1]
            parts = [springs[1:, None] * by_tau * times_s[:, None]]
            if self.contact_free:
                parts.append((springs @ by_contact)[None])
            if self.exponent_free and by_exponent is not None:
                parts.append((springs @ by_exponent)[None])
            return np.concatenate(parts)

        return Rows(np.concatenate([rows, np.ones((1, rows.shape[1]))]), slopes)


def fit_ramp(
    window: FitWindow, n_arms: int = 2, contact: Contact | None = None, exponent: float | None = None
) -> RampSolution:
    """Fit k0, n_arms arms (1 to 4), contact point and offset to a window; CannotFitError with the reason.

    ``contact`` is where the search for the contact point begins, if that is known already. The force grows
    with d^exponent; without one, the loading is asked: a flat punch (1) is kept unless it is contradicted.
    """
    if not 1 <= n_arms <= _MOST_ARMS:
        raise ValueError(f"a fit has 1 to {_MOST_ARMS} arms, not {n_arms}")
    contact = find_contact(window) if contact is None else contact
    blocks = condense(window, contact.sample)
    if exponent is not None and exponent != 1.0:
        law = ContactLaw(exponent, _reference_mm(window, contact))
        return _fit_law(blocks, window, n_arms, law, exponent_free=False)
    try:
        solution, found = solve_blocks(blocks, window, contact, n_arms)
    except CannotFitError:
        if exponent is not None or not contact.seen:
            raise
        return _convex(blocks, window, n_arms, None)
    asked = exponent is None and found.seen
    flat = _finish(window, blocks, solution, found, n_arms, FLAT, asked=asked)
    if not asked or flat.flat:
        return flat
    try:
        convex = _convex(blocks, window, n_arms, flat)
    except CannotFitError:
        return flat
    said = convex.exponent
    contradicted = said is not None and abs(said.value - 1.0) > _CONVEX_SIGMAS * said.se
    return convex if contradicted else replace(flat, exponent=said)


def _reference_mm(window: FitWindow, contact: Contact) -> float:
    """Return the depth in the hold, mm, at which stiffnesses of a convex law are stated."""
    held_mm = window.position_mm[window.hold_start :]
    reach_mm = float(np.median(held_mm[:: max(1, len(held_mm) // 1000)])) - contact.position_mm
    return reach_mm if reach_mm > 0 else max(float(np.ptp(window.position_mm)), 1e-12)


def _fit_law(
    blocks: Blocks,
    window: FitWindow,
    n_arms: int,
    law: ContactLaw,
    *,
    exponent_free: bool,
    start: FloatArray | None = None,
) -> RampSolution:
    """Return the fit by a law, from where its own hinge finds the contact, or from ``start``."""
    contact = find_contact(window, law.exponent)
    if start is not None:
        contact = Contact(float(start[n_arms]), contact.sample, contact.force_before_mn, seen=True)
    finer = law_knots(blocks, contact.position_mm, law.reference_mm)
    solution, found = solve_blocks(
        finer, window, contact, n_arms, start, law=law, exponent_free=exponent_free and contact.seen
    )
    if exponent_free and not found.seen:
        raise CannotFitError("the contact point is not within the recorded motion")
    return _finish(window, finer, solution, found, n_arms, law, exponent_free=exponent_free)


def _convex(blocks: Blocks, window: FitWindow, n_arms: int, flat: RampSolution | None) -> RampSolution:
    """Return the best fit with the exponent free, from several starts; CannotFitError where none ends."""
    found: list[RampSolution] = []
    refused: list[str] = []
    starts: list[tuple[float, FloatArray | None]] = [(exponent, None) for exponent in _CONVEX_STARTS]
    if flat is not None:
        starts.append((1.05, np.append(flat.parameters, 1.05)))
    for exponent, start in starts:
        law = ContactLaw(exponent, _reference_mm(window, find_contact(window, exponent)))
        try:
            found.append(_fit_law(blocks, window, n_arms, law, exponent_free=True, start=start))
        except CannotFitError as reason:
            refused.append(str(reason))
    inside = [one for one in found if LOWEST < one.law.exponent < HIGHEST]
    if not inside:
        raise CannotFitError(refused[0] if refused else "no contact law d^p says the loading")
    return min(inside, key=lambda one: one.squares)


def solve_blocks(
    blocks: Blocks,
    window: FitWindow,
    contact: Contact,
    n_arms: int,
    start: FloatArray | None = None,
    *,
    law: ContactLaw = FLAT,
    exponent_free: bool = False,
) -> tuple[Solution, Contact]:
    """Return the solution on blocks; a contact point that leaves the recorded motion is fixed at its start.

    ``start`` gives log times, contact and exponent; without it they are looked for.
    """
    shortest_s = 2.0 * window.step_s
    longest_s = _LONGEST_HOLDS * max(window.hold_s, shortest_s)
    lowest_mm, highest_mm = float(blocks.position_mm.min()), float(blocks.position_mm.max())
    if highest_mm - lowest_mm <= 0.0:
        raise CannotFitError("the lever did not move: there is no indentation")
    known = Contact(lowest_mm - 1e-9 * max(1.0, abs(lowest_mm)), 0, contact.force_before_mn, seen=False)
    for candidate in (contact, known) if contact.seen else (known,):
        free = exponent_free and candidate.seen
        model = RampModel(blocks, n_arms, candidate.position_mm, candidate.seen, law, free)
        if start is None or len(start) != n_arms + candidate.seen + free:
            begin = _starting_times(blocks, window, candidate.position_mm, n_arms, law)
            begin = np.append(begin, [candidate.position_mm] * candidate.seen + [law.exponent] * free)
        else:
            begin = start
        low, high = np.full(n_arms, np.log(shortest_s)), np.full(n_arms, np.log(longest_s))
        if candidate.seen:
            low, high = np.append(low, lowest_mm), np.append(high, highest_mm)
        if free:
            low, high = np.append(low, LOWEST), np.append(high, HIGHEST)
        solution = solve_separable(
            model, blocks.force_mn, blocks.counts, start=begin, low=low, high=high, n_springs=1 + n_arms
        )
        if not (candidate.seen and solution.at_bound[n_arms]):
            return solution, candidate
    return solution, candidate


def _starting_times(
    blocks: Blocks, window: FitWindow, contact_mm: float, n_arms: int, law: ContactLaw
) -> FloatArray:
    """Return log times (n_arms,), the longest first: the best of all combinations on a grid."""
    first_s = max(8.0 * window.step_s, min(window.hold_s / 2000.0, 0.02))
    last_s = 2.0 * max(window.hold_s, 20.0 * window.step_s)
    grid_s = np.geomspace(min(first_s, last_s / 100.0), last_s, GRID_TIMES)
    rows = block_rows(blocks, contact_mm, grid_s.tolist(), law.level)
    always = np.stack([rows[0], np.ones(rows.shape[1])])
    best_s = best_of_grid(rows[1:], always, blocks.force_mn, blocks.counts, grid_s=grid_s, n_times=n_arms)
    return np.log(best_s)


def _finish(
    window: FitWindow,
    blocks: Blocks,
    solution: Solution,
    contact: Contact,
    n_arms: int,
    law: ContactLaw,
    *,
    exponent_free: bool = False,
    asked: bool = False,
) -> RampSolution:
    """Order the arms, take the residual at every sample, and the covariance from it.

    ``asked``: the loading of this flat fit is asked what it says of the exponent.
    """
    model = RampModel(blocks, n_arms, contact.position_mm, contact.seen, law, exponent_free)
    law, contact_mm = model.law_at(solution.parameters), model.contact_at(solution.parameters)
    log_times = solution.parameters[:n_arms]
    order = np.argsort(-log_times)
    stiffness = np.concatenate([solution.amplitudes[:1], solution.amplitudes[1 : 1 + n_arms][order]])
    times_s = np.exp(log_times[order])
    offset_mn = float(solution.amplitudes[-1])
    force_mn = sampled_force(blocks, contact_mm, stiffness, times_s, law) + offset_mn
    residual_mn = window.force_mn[: len(force_mn)] - force_mn
    noise = measure_noise(residual_mn, solution.jacobian, blocks.edges)
    rest = np.arange(2 * n_arms + 2, len(solution.jacobian))
    jacobian = solution.jacobian[np.concatenate([[0], 1 + order, [n_arms + 1], n_arms + 2 + order, rest])]
    influence = influences(jacobian, blocks.counts)
    doubted = neighbouring_noise(residual_mn)
    loading: Flatness | None = None
    if asked:
        reach = Contact(contact_mm, 0, offset_mn, seen=True)
        loading = ask_flatness(
            blocks,
            contact_mm,
            times_s,
            stiffness,
            offset_mn,
            jacobian=jacobian,
            influence=influence,
            doubted=doubted,
            reference_mm=_reference_mm(window, reach),
        )
        influence = np.concatenate([influence, loading.influence[None]])
    covariance = widened(*noise_covariance(influence, blocks.edges, noise))
    exponent: Estimate | None = None
    if exponent_free or loading is not None:
        value = law.exponent if loading is None else loading.exponent
        exponent = Estimate(value, float(np.sqrt(max(covariance[-1, -1], 0.0))))
    n = len(jacobian)
    return RampSolution(
        stiffness,
        times_s,
        contact_mm,
        contact.seen,
        offset_mn,
        covariance[:n, :n],
        residual_mn,
        noise,
        doubted,
        blocks,
        solution.squares,
        jacobian,
        solution.parameters,
        tuple(solution.at_bound[:n_arms][order].tolist()),
        law,
        exponent_free,
        exponent,
        loading is None or abs(loading.exponent - 1.0) <= _CONVEX_SIGMAS * loading.doubted_se,
    )
