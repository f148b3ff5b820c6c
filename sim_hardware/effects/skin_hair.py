"""Hairs bend before the skin is reached."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Block


class SkinHair(Effect):
    """Hairs stand on the skin: they push first, buckle, and lie flat.

    Shows in the last stretch of the approach and in the retract after the skin is left, as a small force
    that rises to a plateau; in contact it is but a shift.
    """

    name = "skin_hair"
    stage = "specimen"
    in_library = False
    phases = IN_CONTACT
    parameters = (
        Parameter("force_mn", "mN", 1.5, 0.0, 50.0, "force of the buckled hairs"),
        Parameter("length_um", "um", 350.0, 10.0, 3000.0, "how far they stand off the skin"),
    )

    def touch(self, block: Block) -> None:
        """Let the hairs push."""
        if block.skin:
            length_mm = self["length_um"] * 1e-3
            pressed = np.maximum(block.fine_gap_mm + length_mm, 0.0)
            block.fine_force_mn = block.fine_force_mn - self["force_mn"] * np.expm1(
                -pressed / (0.2 * length_mm)
            )
