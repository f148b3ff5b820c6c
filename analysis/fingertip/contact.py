"""A tool pressed into the pad, patch by patch: no patch pulls, none overlaps the tool.

Time passes in steps over which displacement is taken as linear, so that every arm takes a step exactly:
w = E_inf u + sum m_i h_i, dh_i/dt = du/dt - h_i / tau_i. A step is one elastic problem with the moduli
E_inf + sum m_i gamma_i, gamma_i = (1 - exp(-dt / tau_i)) tau_i / dt, and a load that the arms remember.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import nnls

from analysis.fingertip.contact_pad import ContactPad
from analysis.fingertip.viscoelastic import Prony
from analysis.recordings.trial import FloatArray

_MOST_CHANGES = 40


@dataclass(frozen=True, slots=True)
class Pressed:
    """A pad pressed through N steps, with what every step left behind.

    Attributes:
        time_s, tool_mm: (N,) instants and how deep the tool was.
        force_mn: on the tool, (N,).
        weights: of the pad's shapes, (N, n).
        stretches: of every arm of every layer, in shapes, (N, arms, n), the layers' arms one after the other.
        pressure_kpa: of the patches, (N, m).
        overlap_mm, pull_kpa: the worst of either, over all steps; rounding where contact was solved.
    """

    time_s: FloatArray
    tool_mm: FloatArray
    force_mn: FloatArray
    weights: FloatArray
    stretches: FloatArray
    pressure_kpa: FloatArray
    overlap_mm: float
    pull_kpa: float


def press(pad: ContactPad, materials: Sequence[Prony], time_s: FloatArray, tool_mm: FloatArray) -> Pressed:
    """Press a flat tool from (0 s, 0 mm) to depths (N,) mm at instants (N,) s, rising, over a pad of materials (L,).

    Depth counts from the first touch; force is that of the whole pad.
    """
    count, size = len(time_s), pad.layers.shape[1]
    arms = [(layer, m, tau) for layer, material in enumerate(materials) for m, tau in material.arms]
    weights, stretch = np.zeros(size), np.zeros((len(arms), size))
    pressure = np.zeros(len(pad.area_mm2))
    found = Pressed(
        time_s, tool_mm, np.empty(count), np.empty((count, size)), np.empty((count, *stretch.shape)),
        np.empty((count, len(pressure))), 0.0, 0.0,
    )  # fmt: skip
    overlap = pull = before_s = 0.0
    step: _Step | None = None
    for number, (now_s, depth_mm) in enumerate(zip(time_s, tool_mm, strict=True)):
        step_s = float(now_s - before_s)
        if step is None or abs(step_s - step.step_s) > 1e-12 * step_s:
            step = _Step.of(pad, materials, arms, step_s)
        remembered = np.zeros(size)
        for (layer, modulus, _), h, keep, gain in zip(arms, stretch, step.keep, step.gain, strict=True):
            remembered += modulus * pad.layers[layer] @ (gain * weights - keep * h)
        wanted = pad.area_mm2 * (depth_mm - pad.gap_mm) - pad.press @ cho_solve(step.factor, remembered)
        pressure = touching_pressure(step.compliance, wanted, pressure > 0)
        moved = cho_solve(step.factor, remembered + pad.press.T @ pressure)
        stretch = step.keep[:, None] * stretch + step.gain[:, None] * (moved - weights)
        weights, before_s = moved, float(now_s)
        # where skin presses it lies on the tool, where it does not it lies below
        below = pad.press @ weights / pad.area_mm2 - (depth_mm - pad.gap_mm)
        overlap, pull = max(overlap, float(-below.min())), max(pull, float(-pressure.min()))
        found.force_mn[number] = pad.area_mm2 @ pressure
        found.weights[number], found.stretches[number] = weights, stretch
        found.pressure_kpa[number] = pressure
    return Pressed(
        time_s, tool_mm, found.force_mn, found.weights, found.stretches, found.pressure_kpa, overlap, pull
    )


@dataclass(frozen=True, slots=True)
class _Step:
    """What a step of one length needs."""

    step_s: float
    keep: FloatArray
    gain: FloatArray
    factor: tuple[FloatArray, bool]
    compliance: FloatArray

    @classmethod
    def of(
        cls,
        pad: ContactPad,
        materials: Sequence[Prony],
        arms: Sequence[tuple[int, float, float]],
        step_s: float,
    ) -> _Step:
        times = np.array([tau for _, _, tau in arms])
        keep = np.exp(-step_s / times)
        gain = -np.expm1(-step_s / times) * times / step_s
        moduli = np.array([material.relaxed_kpa for material in materials])
        for (layer, modulus, _), share in zip(arms, gain, strict=True):
            moduli[layer] += modulus * share
        factor = cho_factor(np.tensordot(moduli, pad.layers, 1))
        return cls(step_s, keep, gain, factor, pad.press @ cho_solve(factor, pad.press.T))


def touching_pressure(compliance: FloatArray, wanted: FloatArray, touching: np.ndarray) -> FloatArray:
    """Return pressures p (m,) >= 0 with compliance @ p >= wanted, equal where p > 0.

    Starts from what was ``touching`` (m,) and swaps patches that pull for patches that overlap until nothing
    changes (the primal-dual active set of Hintermueller, Ito and Kunisch, 2003), in a few rounds; where that
    goes round in circles, non-negative least squares find the same pressures one patch at a time.
    """
    pressure = np.zeros(len(wanted))
    rounding = 1e-10 * max(float(np.abs(wanted).max()), 1e-300)
    if not touching.any():
        touching = wanted > 0
    for _ in range(_MOST_CHANGES):
        pressure[:] = 0.0
        if touching.any():
            inside = np.flatnonzero(touching)
            pressure[inside] = np.linalg.solve(compliance[np.ix_(inside, inside)], wanted[inside])
        next_touching = np.where(touching, pressure > 0, wanted - compliance @ pressure > rounding)
        if (next_touching == touching).all():
            return pressure
        touching = next_touching
    factor = np.linalg.cholesky(compliance)
    solved: FloatArray = nnls(factor.T, np.linalg.solve(factor, wanted))[0]
    return solved


def ramp_and_hold(
    depth_mm: float, ramp_s: float, hold_s: float, ramp_steps: int, hold_steps: int
) -> tuple[FloatArray, FloatArray]:
    """Return instants (N,) s and depths (N,) mm: even steps through the ramp, then ever longer ones."""
    ramp = ramp_s * np.arange(1, ramp_steps + 1) / ramp_steps
    after = ramp_s + np.geomspace(min(ramp_s / ramp_steps, hold_s / hold_steps), hold_s, hold_steps)
    time_s = np.concatenate([ramp, after])
    return time_s, depth_mm * np.minimum(time_s / ramp_s, 1.0)
