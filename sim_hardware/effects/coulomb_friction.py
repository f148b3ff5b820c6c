"""Dry friction in the motor's bearing."""

from __future__ import annotations

import numpy as np
from numba import njit

from sim_hardware.effects.base import IN_MOTION, Effect, Parameter
from sim_hardware.parts import Block, FloatArray

_BRISTLE_MM = 0.001
_STRIBECK_MM_S = 0.5
_STRIBECK = 0.08
_DITHER_S = 0.006
_STUCK_MM_S = 0.2
_MOVING_MM_S = 1e-3


@njit(cache=True)
def _bristles(velocity: FloatArray, step_s: float, start: float) -> FloatArray:
    """Return the bristles' mean bend over its sliding value; LuGre: z' = v - |v| z / g(v), fading at rest."""
    out = np.empty_like(velocity)
    z = start
    for i in range(velocity.shape[0]):
        v = velocity[i]
        slide = _BRISTLE_MM * (1 + _STRIBECK * np.exp(-((v / _STRIBECK_MM_S) ** 2)))
        rate = abs(v) / slide + np.exp(-((v / _STUCK_MM_S) ** 2)) / _DITHER_S + 1e-9
        settled = v / rate
        z = settled + (z - settled) * np.exp(-rate * step_s)
        out[i] = z / _BRISTLE_MM
    return out


class CoulombFriction(Effect):
    """F gains about Fc against the motion, whatever the speed.

    Shows while the arm moves, contact or not. Rough: bristles bend over 1 um before they slide (LuGre),
    hold 8 % more at creeping speed (Stribeck), and what they hold at rest fades within 6 ms as the servo's
    dither shakes it loose.
    """

    name = "coulomb_friction"
    stage = "sensor"
    in_library = True
    phases = IN_MOTION
    parameters = (Parameter("force_mn", "mN", 2.0, -100.0, 100.0, "sliding friction at the tip"),)
    bend = 0.0

    def sense_fine(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Add the friction."""
        velocity = block.fine_velocity_mm_s
        bristles = _bristles(velocity, block.step_s, self.bend)
        if len(bristles):
            self.bend = float(bristles[-1]) * _BRISTLE_MM
        sign = np.where(np.abs(velocity) > _MOVING_MM_S, np.sign(velocity), 0.0)
        return force_mn + self["force_mn"] * (sign + self.rough * (bristles - sign))

    def rest(self, duration_s: float) -> None:
        """Let what the bristles hold fade."""
        self.bend *= float(np.exp(-duration_s / _DITHER_S))
