"""Relaxing answers to a motion given on uneven cells.

The recursion is that of `analysis.relaxation.response`, exact for motion that is linear between points. Cells come in
few lengths, so the exponentials are computed once a length and the pass over the cells only multiplies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Steps:
    """The times between points: distinct lengths (s) and which of them each of n - 1 steps has."""

    lengths_s: FloatArray
    index: IntArray

    @classmethod
    def between(cls, time_s: FloatArray) -> Steps:
        """Return the steps between the points of a time axis (n,); equal to a part in 10^9 counts as equal."""
        dt = np.diff(time_s)
        lengths, index = np.unique(np.round(dt, 12), return_inverse=True)
        return cls(np.maximum(lengths, 1e-12), index.astype(np.int64))


@njit(cache=True)
def _sum_of_arms(
    drive: FloatArray, index: IntArray, lengths_s: FloatArray, taus_s: FloatArray, weights: FloatArray
) -> FloatArray:
    (bodies, arms), (driven, n) = taus_s.shape, drive.shape
    decay = np.zeros((bodies, len(lengths_s), arms + 1))
    gain = np.zeros_like(decay)
    for body in range(bodies):
        for k in range(len(lengths_s)):
            for m in range(arms):
                ratio = lengths_s[k] / taus_s[body, m]
                decay[body, k, m] = np.exp(-ratio)
                gain[body, k, m] = -np.expm1(-ratio) / ratio * weights[body, m]
    rows = bodies if driven == 1 else driven
    out = np.zeros((rows, n))
    # two arms in two rows stay in registers, and each waits for its own product only; of an odd number the last is
    # done twice, or beside an arm that is none
    for m in range(0, arms, 2):
        other = min(m + 1, arms)
        for row in range(0, rows, 2):
            below = min(row + 1, rows - 1)
            above_drive, below_drive = drive[min(row, driven - 1)], drive[min(below, driven - 1)]
            above_body, below_body = min(row, bodies - 1), min(below, bodies - 1)
            decay_above, gain_above = decay[above_body], gain[above_body]
            decay_below, gain_below = decay[below_body], gain[below_body]
            first, second, first_below, second_below = 0.0, 0.0, 0.0, 0.0
            for i in range(1, n):
                k = index[i - 1]
                moved, moved_below = above_drive[i] - above_drive[i - 1], below_drive[i] - below_drive[i - 1]
                first = decay_above[k, m] * first + gain_above[k, m] * moved
                second = decay_above[k, other] * second + gain_above[k, other] * moved
                first_below = decay_below[k, m] * first_below + gain_below[k, m] * moved_below
                second_below = decay_below[k, other] * second_below + gain_below[k, other] * moved_below
                force, force_below = out[row, i], out[below, i]
                out[row, i] = force + first + second
                out[below, i] = force_below + first_below + second_below
    return out


def arms_force(drive: FloatArray, steps: Steps, taus_s: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the summed force of Maxwell arms with times (m,) s and stiffnesses (m,), driven by rows (..., n).

    h' = d' - h / tau for each; an arm starts with ``drive[..., 0]`` relaxed away. Of several bodies side by side, times
    and stiffnesses (b, m), one drive (n,) moves all, or each row of (b, n) one.
    """
    found = _sum_of_arms(
        np.ascontiguousarray(np.atleast_2d(drive), dtype=np.float64),
        steps.index,
        steps.lengths_s,
        np.atleast_2d(taus_s),
        np.atleast_2d(weights),
    )
    return found if taus_s.ndim == 2 else np.asarray(found.reshape(np.shape(drive)))


def arm_force(drive: FloatArray, steps: Steps, tau_s: float) -> FloatArray:
    """Return the force of one Maxwell arm of unit stiffness, (..., n)."""
    return arms_force(drive, steps, np.array([tau_s]), np.ones(1))


def low_pass(force: FloatArray, steps: Steps, time_constant_s: float) -> FloatArray:
    """Return a piecewise-linear signal (..., n) after a first-order low-pass, exact: T y' + y = F."""
    return force if time_constant_s <= 0 else force - arm_force(force, steps, time_constant_s)


@njit(cache=True)
def _rung(
    drive: FloatArray, index: IntArray, lengths_s: FloatArray, pole: complex, weight: complex
) -> FloatArray:
    decay, gain = np.exp(pole * lengths_s), np.empty(len(lengths_s), dtype=np.complex128)
    for k in range(len(lengths_s)):
        gain[k] = (decay[k] - 1.0) / (pole * lengths_s[k]) * weight
    out = drive.copy()
    for row in range(len(drive)):
        h = 0.0j
        for i in range(1, drive.shape[1]):
            k = index[i - 1]
            h = decay[k] * h + gain[k] * (drive[row, i] - drive[row, i - 1])
            out[row, i] -= 2.0 * h.real
    return out


def resonance(force: FloatArray, steps: Steps, period_s: float, damping_ratio: float) -> FloatArray:
    """Return a piecewise-linear signal (..., n) after a mass on a spring, exact: T^2 y'' + 2 z T y' + y = F.

    ``period_s`` is T, one over the natural frequency, and ``damping_ratio`` z, less than 1. Its two poles are arms of
    complex times, each the other's conjugate.
    """
    pole = complex(-damping_ratio, np.sqrt(1.0 - damping_ratio**2)) / period_s
    # 1 / (T^2 s^2 + 2 z T s + 1) = A / (1 - s / p) and its conjugate
    weight = 1.0 / (1.0 - pole / pole.conjugate())
    rows = np.ascontiguousarray(force.reshape(-1, force.shape[-1]))
    return np.asarray(_rung(rows, steps.index, steps.lengths_s, pole, weight).reshape(force.shape))
