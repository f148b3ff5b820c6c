"""Prony series, and what a pad of such layers answers to any motion of the punch.

A layer's modulus relaxes as E(t) = E_0 g(t), g(t) = 1 - sum_i g_i (1 - exp(-t / tau_i)), at one Poisson's
ratio, so that its stress is sigma(t) = sigma_0(t) + integral of dg/ds(s) sigma_0(t - s) ds. (Equation 6 of
Kumar et al. 2015 prints g where its derivative has to stand.) With q the stretch of every arm's spring in a
layer's own coordinates, what holds the arms back is the symmetric matrix

    S = T^(-1/2) (I - H_c K_cc^(-1) H_c^T) T^(-1/2),

T the arms' times, H_c what the free shapes stretch, K_cc their stiffness at an instant. Its eigenvalues
are the rates at which the pad relaxes: the force on the punch is that of a spring and as many Maxwell arms, none
of them negative, and no step of time is needed for a motion that is linear between its samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.recordings.trial import FloatArray

_NOTHING = 1e-14


@dataclass(frozen=True, slots=True)
class Prony:
    """A layer's relaxation: relaxed modulus (kPa), and its arms: (modulus in kPa, time in s), none if elastic."""

    relaxed_kpa: float
    arms: tuple[tuple[float, float], ...] = ()

    @property
    def instantaneous_kpa(self) -> float:
        """The modulus at once, E_0."""
        return self.relaxed_kpa + sum(modulus for modulus, _ in self.arms)

    @property
    def g(self) -> tuple[float, ...]:
        """The g_i, as published: each arm's share of E_0."""
        return tuple(modulus / self.instantaneous_kpa for modulus, _ in self.arms)

    def scaled(self, factor: float) -> Prony:
        """Return the same relaxation of another modulus."""
        return Prony(self.relaxed_kpa * factor, tuple((m * factor, t) for m, t in self.arms))

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return E(t), (N,) kPa."""
        time_s = np.asarray(time_s, dtype=float)
        modulus: FloatArray = self.relaxed_kpa + sum(
            (m * np.exp(-time_s / tau) for m, tau in self.arms), np.zeros_like(time_s)
        )
        return modulus


@dataclass(frozen=True, slots=True)
class Relaxation:
    """A force's relaxation: spring (mN/mm), and arms' stiffness (M,) mN/mm and times (M,) s, longest first."""

    relaxed_mn_per_mm: float
    arms_mn_per_mm: FloatArray
    times_s: FloatArray

    def after_step(self, time_s: FloatArray) -> FloatArray:
        """Return the force of a step of 1 mm, (N,) mN."""
        decays = np.exp(-np.asarray(time_s)[:, None] / self.times_s)
        force_mn: FloatArray = self.relaxed_mn_per_mm + decays @ self.arms_mn_per_mm
        return force_mn

    def after_ramp(self, time_s: FloatArray, ramp_s: float) -> FloatArray:
        """Return the force of a ramp to 1 mm in ``ramp_s`` and a hold, (N,) mN, from the first touch on."""
        time_s = np.asarray(time_s, dtype=float)
        going = np.minimum(time_s, ramp_s)[:, None]
        rested = np.maximum(time_s - ramp_s, 0.0)[:, None]
        tau = self.times_s
        stretch = -np.expm1(-going / tau) * tau / ramp_s * np.exp(-rested / tau)
        force_mn: FloatArray = self.relaxed_mn_per_mm * going[:, 0] / ramp_s + stretch @ self.arms_mn_per_mm
        return force_mn

    def force_mn(self, depth_mm: FloatArray, time: float | FloatArray) -> FloatArray:
        """Return the force (N,) mN of any motion (N,) mm, exact where it is linear between its samples."""
        from analysis.relaxation.response import force_response

        arms = list(zip(self.arms_mn_per_mm.tolist(), self.times_s.tolist(), strict=True))
        return force_response(depth_mm, time, self.relaxed_mn_per_mm, arms, clip=False)

    def thinned(self, tolerance: float) -> Relaxation:
        """Return the same with few arms: neighbours in time joined while the step response stays within
        ``tolerance`` of its start.
        """
        from scipy.optimize import nnls

        start = self.relaxed_mn_per_mm + self.arms_mn_per_mm.sum()
        time_s = np.concatenate([[0.0], np.geomspace(self.times_s.min() / 30, self.times_s.max() * 10, 300)])
        wanted = self.after_step(time_s)
        order = np.argsort(-self.arms_mn_per_mm)
        for count in range(1, len(order) + 1):
            taus = self.times_s[np.sort(order[:count])]
            basis = np.column_stack([np.ones_like(time_s), np.exp(-time_s[:, None] / taus)])
            stiffness, _ = nnls(basis, wanted)
            if np.abs(basis @ stiffness - wanted).max() <= tolerance * start:
                kept = stiffness[1:] > 0
                return Relaxation(float(stiffness[0]), stiffness[1:][kept], taus[kept])
        return self


def relaxation(layers: FloatArray, materials: Sequence[Prony]) -> Relaxation:
    """Return the force's relaxation of a pad of ``layers`` (L, n, n) mN/mm per kPa, its first shape driven."""
    stiffness = np.tensordot([m.instantaneous_kpa for m in materials], layers, 1)
    stretches, times = _stretches(layers, materials)
    free = stiffness[1:, 1:]
    follows = np.linalg.solve(free, np.column_stack([stiffness[1:, 0], stretches[:, 1:].T]))
    at_once = stiffness[0, 0] - stiffness[0, 1:] @ follows[:, 0]
    if not len(times):
        return Relaxation(float(at_once), np.empty(0), np.empty(0))
    driven = stretches[:, 0] - stretches[:, 1:] @ follows[:, 0]
    held = np.eye(len(times)) - stretches[:, 1:] @ follows[:, 1:]
    root = 1 / np.sqrt(times)
    rates, modes = np.linalg.eigh((held + held.T) / 2 * root[:, None] * root)
    arms = (modes.T @ (root * driven)) ** 2 / rates
    kept = arms > _NOTHING * at_once
    return Relaxation(float(at_once - arms.sum()), arms[kept], 1 / rates[kept])


def _stretches(layers: FloatArray, materials: Sequence[Prony]) -> tuple[FloatArray, FloatArray]:
    """Return H (M, n): what each shape stretches every arm by, in units that make its energy |q|^2 / 2."""
    rows, times = [], []
    for matrix, material in zip(layers, materials, strict=True):
        if not material.arms:
            continue
        values, vectors = np.linalg.eigh(matrix)
        kept = values > _NOTHING * values[-1]
        factor = np.sqrt(values[kept])[:, None] * vectors[:, kept].T
        for modulus, tau in material.arms:
            rows.append(np.sqrt(modulus) * factor)
            times.append(np.full(len(factor), tau))
    if not rows:
        return np.empty((0, layers.shape[1])), np.empty(0)
    return np.concatenate(rows), np.concatenate(times)
