"""Dry friction in the motor's bearing."""

from __future__ import annotations

import numpy as np
from numba import njit

from sim_hardware.effects.base import IN_MOTION, Effect, Parameter
from sim_hardware.parts import Block, FloatArray

_STRIBECK_MM_S = 0.5
_DITHER_S = 0.006
_STUCK_MM_S = 0.2
_MOVING_MM_S = 1e-3


@njit(cache=True)
def _bristles(
    velocity: FloatArray, step_s: float, start: float, length: float, stribeck: float
) -> FloatArray:
    """Return the bristles' mean bend over its sliding value; LuGre: z' = v - |v| z / g(v), fading at rest.

    ``length`` (mm) is the bend at which they slide, ``stribeck`` the share they hold more at creeping speed.
    """
    out = np.empty_like(velocity)
    z = start
    for i in range(velocity.shape[0]):
        v = velocity[i]
        slide = length * (1 + stribeck * np.exp(-((v / _STRIBECK_MM_S) ** 2)))
        rate = abs(v) / slide + np.exp(-((v / _STUCK_MM_S) ** 2)) / _DITHER_S + 1e-9
        settled = v / rate
        z = settled + (z - settled) * np.exp(-rate * step_s)
        out[i] = z / length
    return out


class CoulombFriction(Effect):
    """F gains about Fc against the motion, whatever the speed.

    Shows while the arm moves, contact or not. Rough: bristles bend over ``presliding_um`` before they slide
    (LuGre), hold the share ``stribeck`` more at creeping speed, and what they hold at rest fades within 6 ms
    as the servo's dither shakes it loose.
    """

    name = "coulomb_friction"
    stage = "sensor"
    in_library = True
    phases = IN_MOTION
    parameters = (
        Parameter("force_mn", "mN", 2.0, -100.0, 100.0, "sliding friction at the tip"),
        Parameter("presliding_um", "um", 1.0, 0.1, 50.0, "travel before it slides"),
        Parameter("stribeck", "1", 0.08, 0.0, 1.0, "how much more it holds at creeping speed"),
    )
    bend = 0.0

    def sense_fine(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Add the friction."""
        velocity = block.fine_velocity_mm_s
        length = self["presliding_um"] * 1e-3
        bristles = _bristles(velocity, block.step_s, self.bend, length, self["stribeck"])
        if len(bristles):
            self.bend = float(bristles[-1]) * length
        sign = np.where(np.abs(velocity) > _MOVING_MM_S, np.sign(velocity), 0.0)
        return force_mn + self["force_mn"] * (sign + self.rough * (bristles - sign))

    def rest(self, duration_s: float) -> None:
        """Let what the bristles hold fade."""
        self.bend *= float(np.exp(-duration_s / _DITHER_S))
