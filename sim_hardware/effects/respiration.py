"""The breath lifts the hand."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Block, FloatArray
from sim_hardware.wander import Wander


class Respiration(Effect):
    """The surface moves with the breath, its phase not locked to the trial.

    Shows in every contact. Rough: breathing is irregular, its rate varies by 3 % and its depth by 12 %, and
    breathing in is faster than breathing out (a second harmonic of 15 %).
    """

    name = "respiration"
    stage = "specimen"
    in_library = True
    phases = IN_CONTACT
    parameters = (
        Parameter("amplitude_um", "um", 15.0, 0.0, 2000.0, "amplitude of the fundamental"),
        Parameter("frequency_hz", "Hz", 0.3, 0.05, 1.5, "mean rate"),
        Parameter("wander", "1", 1.0, 0.0, 5.0, "how much rate and size wander, over what is usual"),
    )

    def begin_trial(self, trial: int) -> None:
        """Draw how the breath wanders, once for all."""
        if trial == 0:
            self.phase = float(self.random.uniform(0, 2 * np.pi))
            self.rate = Wander(self.random, 0.01, 0.1)
            self.size = Wander(self.random, 0.01, 0.1)

    def surface_mm(self, block: Block) -> FloatArray:
        """Return the breath."""
        t, f, wander = block.time_s, self["frequency_hz"], self.rough * self["wander"]
        turn = 2 * np.pi * f * (t + 0.03 * wander * self.rate.integral(t)) + self.phase
        breath = np.sin(turn)
        if self.rough:
            breath += 0.15 * self.rough * np.sin(2 * turn + 0.7)
            breath *= 1 + 0.12 * wander * self.size(t)
        return self["amplitude_um"] * 1e-3 * breath
