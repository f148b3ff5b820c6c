"""The punch lands on its edge."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import Effect, Parameter
from sim_hardware.parts import Block


class EdgeContact(Effect):
    """A punch that is not square to the skin lands on its edge, and all of it bears only some way deeper.

    Shows at small depths as a force that lacks a share, in the approach, the dwell, and the start of the ramp
    and the end of the retract. Rough: each site is tilted differently, by 25 %.
    """

    name = "edge_contact"
    stage = "contact"
    in_library = False
    phases = ("approach", "dwell", "ramp", "retract")
    parameters = (
        Parameter("lack", "1", 0.5, 0.0, 1.0, "share of the force that is lacking at first touch"),
        Parameter("depth_um", "um", 60.0, 1.0, 1000.0, "depth at which most of the punch bears"),
    )
    tilt = 1.0

    def begin_trial(self, trial: int) -> None:
        """Draw this site's tilt."""
        self.tilt = 1 + 0.25 * self.rough * float(np.clip(self.random.standard_normal(), -2, 2))

    def touch(self, block: Block) -> None:
        """Let a part of the punch bear."""
        if block.skin:
            depth = np.maximum(block.fine_gap_mm, 0.0) / (self["depth_um"] * 1e-3 * self.tilt)
            block.fine_force_mn = block.fine_force_mn * (1 - self["lack"] * np.exp(-(depth**2)))
