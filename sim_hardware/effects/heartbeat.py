"""The pulse lifts the skin."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Block, FloatArray
from sim_hardware.wander import Wander


class Heartbeat(Effect):
    """The surface moves with the pulse, its phase not locked to the trial.

    Shows in every contact. Rough: a pulse has the harmonics of a pressure wave (35 % and 15 %), its rate
    varies by 2 % with the breath and slower, and its size by 10 %.
    """

    name = "heartbeat"
    stage = "specimen"
    in_library = True
    phases = IN_CONTACT
    parameters = (
        Parameter("amplitude_um", "um", 5.0, 0.0, 500.0, "amplitude of the fundamental"),
        Parameter("frequency_hz", "Hz", 1.3, 0.5, 6.0, "mean rate"),
        Parameter("wander", "1", 1.0, 0.0, 5.0, "how much rate and size wander, over what is usual"),
    )

    def begin_trial(self, trial: int) -> None:
        """Draw how the heart wanders, once for all."""
        if trial == 0:
            self.phase = float(self.random.uniform(0, 2 * np.pi))
            self.rate = Wander(self.random, 0.02, 0.3)
            self.size = Wander(self.random, 0.02, 0.3)

    def surface_mm(self, block: Block) -> FloatArray:
        """Return the pulse."""
        t, f, wander = block.time_s, self["frequency_hz"], self.rough * self["wander"]
        turn = 2 * np.pi * f * (t + 0.02 * wander * self.rate.integral(t)) + self.phase
        pulse = np.sin(turn)
        if self.rough:
            pulse += self.rough * (0.35 * np.sin(2 * turn + 1.0) + 0.15 * np.sin(3 * turn + 2.0))
            pulse *= 1 + 0.1 * wander * self.size(t)
        return self["amplitude_um"] * 1e-3 * pulse
