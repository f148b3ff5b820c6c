"""A switching supply beats with the sample clock."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import ALWAYS, Effect, Parameter
from sim_hardware.parts import Block, FloatArray
from sim_hardware.wander import Wander


class SwitchingBeat(Effect):
    """A supply that switches near a multiple of 8 kHz: sampling folds it down to a whistle.

    Shows in every phase as a tone that wanders over hundreds of hertz within seconds, through zero and back,
    as the switcher's load changes: no line, no band. There is no filter in front of the converter.
    """

    name = "switching_beat"
    stage = "sensor"
    in_library = False
    phases = ALWAYS
    order = 90
    parameters = (
        Parameter("amplitude_mn", "mN", 0.6, 0.0, 50.0, "amplitude of the whistle"),
        Parameter("wander_hz", "Hz", 300.0, 1.0, 3000.0, "rms of its wandering frequency"),
    )

    def begin_trial(self, trial: int) -> None:
        """Draw how it wanders, once for all."""
        if trial == 0:
            self.rate = Wander(self.random, 0.03, 0.4)

    def sense(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Add the whistle."""
        turn = 2 * np.pi * self["wander_hz"] * self.rate.integral(block.time_s)
        return force_mn + self["amplitude_mn"] * np.sin(turn)
