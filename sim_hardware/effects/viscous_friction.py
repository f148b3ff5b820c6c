"""Grease and air hold the moving arm back."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import IN_MOTION, Effect, Parameter
from sim_hardware.parts import Block, FloatArray

_KNEE_MM_S = 5.0


class ViscousFriction(Effect):
    """F gains c dx/dt, contact or not.

    Shows while the arm moves. Rough: the grease thins with shear, c falls with speed as (1 + (v / 5)^2)^-0.05
    and has its declared value at 5 mm/s.
    """

    name = "viscous_friction"
    stage = "sensor"
    in_library = True
    phases = IN_MOTION
    parameters = (
        Parameter("coefficient_mn_s_per_mm", "mN s/mm", 0.3, -50.0, 50.0, "drag at the tip per speed"),
    )

    def sense_fine(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Add the drag."""
        velocity = block.fine_velocity_mm_s
        thin = ((1 + (velocity / _KNEE_MM_S) ** 2) / 2) ** (-0.05 * self.rough)
        return force_mn + self["coefficient_mn_s_per_mm"] * velocity * np.asarray(thin)
