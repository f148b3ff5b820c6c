"""The force channel feels where the arm is: its weight, the motor's own spring."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import ALWAYS, Effect, Parameter
from sim_hardware.parts import Block, FloatArray

_MIDDLE_MM = 5.0
_RADIUS_MM = 30.0


class PositionCrosstalk(Effect):
    """F gains g x, contact or not.

    Shows in every phase, as a slope over the travel. Rough: the weight's torque follows the sine of the
    angle and the motor's magnet adds a curvature of 1 % per mm.
    """

    name = "position_crosstalk"
    stage = "sensor"
    in_library = True
    phases = ALWAYS
    parameters = (Parameter("gain_mn_per_mm", "mN/mm", 0.5, -50.0, 50.0, "force per travel in free air"),)

    def sense_fine(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Add the arm's weight and the motor's spring."""
        x = block.fine_position_mm - _MIDDLE_MM
        real = _RADIUS_MM * np.sin(x / _RADIUS_MM) + 0.01 * x**2
        return force_mn + self["gain_mn_per_mm"] * (x + self.rough * (real - x))
