"""The punch creaks along the skin's ridges."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import Effect, Parameter
from sim_hardware.parts import Block


class StickSlip(Effect):
    """The side of the punch catches on ridge after ridge and lets go of each at once: a saw over the depth.

    Shows in contact while the depth changes, and holds in the dwell and the hold where it stopped. Rough: the
    ridges are uneven, by a quarter of their distance. It grows with the force up to 20 mN.
    """

    name = "stick_slip"
    stage = "contact"
    in_library = False
    phases = ("approach", "dwell", "ramp", "hold", "retract")
    parameters = (
        Parameter("height_mn", "mN", 2.0, 0.0, 50.0, "height of the saw"),
        Parameter("ridge_um", "um", 60.0, 2.0, 1000.0, "distance of the ridges"),
    )
    first = 0.0

    def begin_trial(self, trial: int) -> None:
        """Draw where the first ridge lies."""
        self.first = float(self.random.random())

    def touch(self, block: Block) -> None:
        """Catch and let go."""
        if block.skin:
            at = block.fine_gap_mm / (self["ridge_um"] * 1e-3) + self.first
            at = at + 0.25 * self.rough * np.sin(2 * np.pi * at / 3.7)
            saw = at - np.floor(at) - 0.5
            grown = np.clip(block.fine_force_mn / 20.0, 0.0, 1.0)
            block.fine_force_mn = block.fine_force_mn + self["height_mn"] * saw * grown
