"""Skin that was pressed before is softer, up to where it was pressed."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Block


class Mullins(Effect):
    """The force lacks a share wherever the skin is less deep than it has ever been, the more the less deep.

    Shows in the retract of every trial and in the whole contact of trials that are shallower than an earlier
    one of the session: the first, deepest press softens the pad for all that follow (Mullins). Rough: half of
    what is lost grows only over the first 10 % below the greatest depth. Textbook: in proportion.
    """

    name = "mullins"
    stage = "tissue"
    in_library = False
    phases = IN_CONTACT
    parameters = (
        Parameter("softening", "1", 0.08, 0.0, 0.9, "share of the force lost far below that depth"),
    )
    deepest_mm = 0.0

    def touch(self, block: Block) -> None:
        """Soften the skin."""
        if not block.skin or not len(block.fine_gap_mm):
            return
        depth = np.maximum(block.fine_gap_mm, 0.0)
        deepest = np.maximum(np.maximum.accumulate(depth), self.deepest_mm)
        self.deepest_mm = float(deepest[-1])
        below = 1 - np.divide(depth, deepest, out=np.ones_like(depth), where=deepest > 0)
        lost = below + 0.5 * self.rough * (-np.expm1(-below / 0.1) - below)
        block.fine_force_mn = block.fine_force_mn * (1 - self["softening"] * lost)
