"""A seal that is pressed by the force it measures."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import Effect, Parameter
from sim_hardware.parts import Block, FloatArray

_CREEPING_MM_S = 0.3


class PressedSeal(Effect):
    """Dry friction in the guide of the punch that grows with the force on it.

    Shows while the arm moves in contact, against the motion and in proportion to the force. Rough: it grows
    less than in proportion (power 0.8, the same at 50 mN).
    """

    name = "pressed_seal"
    stage = "sensor"
    in_library = False
    phases = ("approach", "ramp", "retract")
    parameters = (Parameter("share", "1", 0.03, 0.0, 0.9, "friction over force"),)

    def sense_fine(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Add the friction."""
        pressed = np.maximum(force_mn, 0.0)
        grown = 50.0 * (pressed / 50.0) ** (1 - 0.2 * self.rough)
        return force_mn + self["share"] * grown * np.tanh(block.fine_velocity_mm_s / _CREEPING_MM_S)
