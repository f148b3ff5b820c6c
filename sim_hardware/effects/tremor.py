"""The finger trembles."""

from __future__ import annotations

import math

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Block, FloatArray
from sim_hardware.wander import Wander

_BAND = 0.05


class Tremor(Effect):
    """The surface moves in a narrow band around the muscles' rhythm.

    Shows in every contact. Rough: band-limited noise, 5 % of the frequency to either side, so that it waxes
    and wanes over seconds; its rms is that of a sine of the declared amplitude. Textbook: that sine.
    """

    name = "tremor"
    stage = "specimen"
    in_library = True
    phases = IN_CONTACT
    parameters = (
        Parameter("amplitude_um", "um", 2.0, 0.0, 500.0, "rms times the square root of 2"),
        Parameter("frequency_hz", "Hz", 9.0, 2.0, 40.0, "middle of the band"),
    )

    def begin_trial(self, trial: int) -> None:
        """Draw the lines of the band once for all."""
        if trial == 0:
            f, band = self["frequency_hz"], _BAND * self.rough
            n = 9 if self.rough else 1
            self.wander = Wander(self.random, f * (1 - band), f * (1 + band), n)

    def surface_mm(self, block: Block) -> FloatArray:
        """Return the tremor."""
        return self["amplitude_um"] * 1e-3 / math.sqrt(2) * self.wander(block.time_s)
