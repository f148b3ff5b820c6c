"""The creep of a pause in which force was held, by the same solid: its compliance driven by the recorded force.

What the solid's relaxation modulus is to a motion, its creep compliance is to a force (Ferry, Viscoelastic
Properties of Polymers, 1980, ch. 3):

    u(t) = J_g F(t) + sum_j J_j (F(t) - r_j(t)),     dr_j/dt = dF/dt - r_j / lambda_j

with as many retardation times lambda_j as there are arms. In s, the Carson transforms of the two are each other's
reciprocal, so that relaxation times are the zeros of the compliance: `solid_of` turns one into the other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from analysis.recordings.trial import FloatArray
from analysis.relaxation.blocks import growing_edges
from analysis.relaxation.contact import Contact
from analysis.relaxation.contact_law import FLAT, ContactLaw
from analysis.relaxation.noise import estimate_covariance, measure_noise
from analysis.relaxation.response import arm_response
from analysis.relaxation.windows import CannotFitError, FitWindow

_RAMP_PARTS = 80
_STEP = 1e-5  # of a logarithm, for derivatives by differences
_STARTS = ((0.5, 0.02), (0.2, 0.005), (1.0, 0.1))  # retardation times in pauses
_LONGEST_PAUSES = 30.0


@dataclass(frozen=True, slots=True)
class CreepSolution:
    """The fitted solid: stiffnesses (1 + n_arms,) mN/mm, k0 first; times (n_arms,) s, longest first.

    ``covariance`` is that of (k0, k1.., log t1..). ``residual_mm`` (N,) is that of the position after contact;
    ``at_bound`` (n_arms,) says which retardation times, longest first, stopped at a bound.
    """

    stiffness_mn_per_mm: FloatArray
    times_s: FloatArray
    covariance: FloatArray
    contact_mm: float
    depth_mm: float
    residual_mm: FloatArray
    at_bound: tuple[bool, ...]
    law: ContactLaw


def solid_of(
    glass: float, compliances: FloatArray, retardation_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return stiffnesses (1 + n,) mN/mm, k0 first, and times (n,) s, longest first, of a creep compliance.

    ``glass`` is the instantaneous compliance, mm/mN, ``compliances`` (n,) those of the retarded parts.
    """
    polynomial = np.array([glass])
    for lag in retardation_s:
        polynomial = np.convolve(polynomial, [lag, 1.0])
    for j, compliance in enumerate(compliances):
        others = np.array([compliance])
        for m, lag in enumerate(retardation_s):
            if m != j:
                others = np.convolve(others, [lag, 1.0])
        polynomial[-len(others) :] += others
    roots = np.sort(np.real(np.roots(polynomial)))[::-1]
    times_s = np.asarray(-1.0 / roots, dtype=float)
    slopes = -np.sum(compliances * retardation_s / np.square(1.0 + np.outer(roots, retardation_s)), axis=1)
    k0 = 1.0 / (glass + float(np.sum(compliances)))
    return np.concatenate([[k0], -times_s / slopes]), times_s


def fit_creep(window: FitWindow, contact: Contact, law: ContactLaw = FLAT, n_arms: int = 2) -> CreepSolution:
    """Fit the solid to loading and pause of a window whose ``hold_start`` is where the force was reached.

    The contact point is fitted along; the law is held. CannotFitError with the reason.
    """
    from scipy.optimize import least_squares

    first = max(contact.sample, 1)
    edges = _edges(window, first)
    if len(edges) < 20:
        raise CannotFitError(f"creep too short to fit: {len(edges)} means of samples, 20 are needed")
    counts = np.diff(edges).astype(float)
    time_s, force_mn, position_mm = (
        np.add.reduceat(values[: edges[-1]], edges[:-1]) / counts
        for values in (window.time_s, window.force_mn, window.position_mm)
    )
    force_mn = force_mn - contact.force_before_mn
    # the force starts from nothing at the instant of contact
    time_s, force_mn = np.append(window.time_s[first - 1], time_s), np.append(0.0, force_mn)
    held_mn, roots = float(np.median(force_mn[-len(force_mn) // 4 :])), np.sqrt(counts)
    depth_mm = float(position_mm[-1]) - contact.position_mm
    if held_mn <= 0 or depth_mm <= 0:
        raise CannotFitError("no creep to fit: neither force nor depth rises above that before contact")

    def modelled(parameters: FloatArray) -> FloatArray:
        glass, *compliances = np.exp(parameters[1 : 2 + n_arms])
        level = glass * force_mn
        for compliance, lag in zip(compliances, np.exp(parameters[2 + n_arms :]), strict=True):
            level = level + compliance * (force_mn - arm_response(force_mn, time_s, float(lag)))
        share = np.maximum(level[1:], 0.0) / law.reference_mm
        return np.asarray(parameters[0] + law.reference_mm * share ** (1.0 / law.exponent), dtype=float)

    def missed(parameters: FloatArray) -> FloatArray:
        return np.asarray((modelled(parameters) - position_mm) * roots, dtype=float)

    pause_s = window.hold_s
    shortest_s, longest_s = 2.0 * window.step_s, _LONGEST_PAUSES * pause_s
    reach = float(law.level(np.array([depth_mm]))[0]) / held_mn
    low = np.array([position_mm.min() - depth_mm, *[np.log(reach) - 20.0] * (1 + n_arms)])
    low = np.append(low, [np.log(shortest_s)] * n_arms)
    high = np.array([position_mm.max(), *[np.log(reach) + 8.0] * (1 + n_arms), *[np.log(longest_s)] * n_arms])
    tries = []
    for shares in _STARTS:
        lags = np.clip(
            np.log(np.array(shares[:n_arms]) * pause_s), np.log(shortest_s) + 1e-3, np.log(longest_s)
        )
        begin = np.array([contact.position_mm, np.log(0.7 * reach), *[np.log(0.15 * reach)] * n_arms, *lags])
        begin = np.clip(begin, low + 1e-9, high - 1e-9)
        tries.append(least_squares(missed, begin, bounds=(low, high), x_scale="jac", max_nfev=200))
    best = min(tries, key=lambda one: float(one.cost))
    return _finished(window, best.x, modelled, edges, low=low, high=high, law=law, n_arms=n_arms)


def _edges(window: FitWindow, first: int) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Return block edges from contact on: even parts of the loading, then ever longer ones of the pause."""
    step = max(1, (window.hold_start - first) // _RAMP_PARTS)
    loading = np.arange(first, window.hold_start, step)
    n = len(window.time_s)
    pause = (
        growing_edges(window.hold_start, n)
        if n - window.hold_start > 400
        else np.arange(window.hold_start, n)
    )
    return np.unique(np.concatenate([loading, pause, [n]])).astype(np.int64)


def _finished(
    window: FitWindow,
    parameters: FloatArray,
    modelled: Callable[[FloatArray], FloatArray],
    edges: np.ndarray[tuple[int], np.dtype[np.int64]],
    *,
    low: FloatArray,
    high: FloatArray,
    law: ContactLaw,
    n_arms: int,
) -> CreepSolution:
    """Return the solid of fitted compliances, with the covariance from the residual's own noise."""
    jacobian = np.stack(
        [
            (modelled(parameters + shift) - modelled(parameters - shift)) / (2.0 * _STEP)
            for shift in _STEP * np.eye(len(parameters))
        ]
    )
    centres = 0.5 * (window.time_s[edges[:-1]] + window.time_s[edges[1:] - 1])
    samples = slice(int(edges[0]), int(edges[-1]))
    said_mm = np.interp(window.time_s[samples], centres, modelled(parameters))
    residual_mm = window.position_mm[samples] - said_mm
    shifted = edges - edges[0]
    own = estimate_covariance(jacobian, shifted, measure_noise(residual_mm, jacobian, shifted))

    def solid(p: FloatArray) -> FloatArray:
        stiffness, times_s = solid_of(float(np.exp(p[1])), np.exp(p[2 : 2 + n_arms]), np.exp(p[2 + n_arms :]))
        return np.concatenate([stiffness, np.log(times_s)])

    slopes = np.stack(
        [
            (solid(parameters + s) - solid(parameters - s)) / (2.0 * _STEP)
            for s in _STEP * np.eye(len(parameters))
        ],
        axis=1,
    )
    found = solid(parameters)
    if not np.all(np.isfinite(found)):
        raise CannotFitError("no springs and dashpots fit: the creep is not that of a solid")
    order = np.argsort(-parameters[2 + n_arms :])
    stopped = (parameters <= low + 1e-6) | (parameters >= high - 1e-6)
    lags = stopped[2 + n_arms :] | stopped[2 : 2 + n_arms]
    return CreepSolution(
        stiffness_mn_per_mm=found[: 1 + n_arms],
        times_s=np.exp(found[1 + n_arms :]),
        covariance=np.asarray(slopes @ own @ slopes.T, dtype=float),
        contact_mm=float(parameters[0]),
        depth_mm=float(np.median(window.position_mm[window.hold_start :])) - float(parameters[0]),
        residual_mm=residual_mm,
        at_bound=tuple(lags[order].tolist()),
        law=law,
    )
