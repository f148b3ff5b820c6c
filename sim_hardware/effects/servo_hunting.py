"""The servo hunts around its target."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import ALWAYS, Effect, Parameter
from sim_hardware.parts import Block, FloatArray
from sim_hardware.wander import Wander


class ServoHunting(Effect):
    """Too much integral gain against a sticky bearing: the motor circles its target in slow triangles.

    Shows in the recorded position in every phase, and in the force where there is contact: a real motion,
    which the tissue feels. Its size wanders over seconds.
    """

    name = "servo_hunting"
    stage = "lever"
    in_library = False
    phases = ALWAYS
    parameters = (
        Parameter("amplitude_um", "um", 2.0, 0.0, 200.0, "mean amplitude of the triangle"),
        Parameter("frequency_hz", "Hz", 23.0, 1.0, 200.0, "its frequency"),
    )

    def begin_trial(self, trial: int) -> None:
        """Draw how it wanders, once for all."""
        if trial == 0:
            self.rate = Wander(self.random, 0.05, 0.5)
            self.size = Wander(self.random, 0.05, 0.5)

    def drive_mm(self, block: Block) -> FloatArray:
        """Return the hunting."""
        t = block.time_s
        turn = self["frequency_hz"] * (t + 0.03 * self.rate.integral(t))
        triangle = 4 * np.abs(turn - np.floor(turn) - 0.5) - 1
        swell = 1 + 0.3 * self.size(t)
        return np.asarray(self["amplitude_um"] * 1e-3 * swell * triangle)
