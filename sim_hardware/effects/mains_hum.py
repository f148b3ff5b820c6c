"""The mains couple into the force channel."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import ALWAYS, Effect, Parameter
from sim_hardware.parts import Block, FloatArray
from sim_hardware.wander import Wander


class MainsHum(Effect):
    """F gains a sine at the mains frequency, contact or not, its phase not locked to the trial.

    Shows in every phase. Rough: the amplitude wanders by 8 % and the frequency by 0.02 Hz over seconds to
    minutes, and a second and third harmonic (10 % and 5 %) come with it.
    """

    name = "mains_hum"
    stage = "sensor"
    in_library = True
    phases = ALWAYS
    order = 30
    parameters = (
        Parameter("amplitude_mn", "mN", 0.5, 0.0, 50.0, "amplitude of the fundamental"),
        Parameter("frequency_hz", "Hz", 50.0, 1.0, 4000.0, "its frequency"),
    )

    def begin_trial(self, trial: int) -> None:
        """Draw the phases once for all."""
        if trial == 0:
            self.phase = self.random.uniform(0, 2 * np.pi, 3)
            self.size = Wander(self.random, 0.02, 0.3)
            self.rate = Wander(self.random, 0.005, 0.05)

    def sense(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Add the hum."""
        t = block.time_s
        turn = 2 * np.pi * (self["frequency_hz"] * t + 0.02 * self.rough * self.rate.integral(t))
        hum = np.asarray(np.sin(turn + self.phase[0]))
        if self.rough:
            hum += 0.1 * self.rough * np.sin(2 * turn + self.phase[1])
            hum += 0.05 * self.rough * np.sin(3 * turn + self.phase[2])
            hum *= 1 + 0.08 * self.rough * self.size(t)
        return force_mn + self["amplitude_mn"] * hum
