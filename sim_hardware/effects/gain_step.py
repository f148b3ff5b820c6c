"""The amplifier's gain changes in mid-trial."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import Effect, Parameter
from sim_hardware.parts import Block, FloatArray

_AFTER_TOUCH_S = 1.0


class GainStep(Effect):
    """A bad contact at the bridge's supply: from one moment on all force reads larger by a share.

    Shows from that moment, a second after the first touch at the earliest, to the end of contact, in the
    trials that have it, in proportion to the force; the zero stays. Repaired before the next trial.
    """

    name = "gain_step"
    stage = "sensor"
    in_library = False
    phases = ("dwell", "ramp", "hold", "retract")
    order = 65
    parameters = (
        Parameter("change", "1", 0.05, -1.0, 1.0, "relative change of the gain"),
        Parameter("time_s", "s", 5.0, 0.0, 1000.0, "mean time, counted from the trial's start"),
        Parameter("share", "1", 0.5, 0.0, 1.0, "share of the trials that have it"),
        Parameter("scatter_s", "s", 1.5, 0.0, 5.0, "standard deviation of the time over trials"),
    )
    change = 0.0
    at_s = 0.0
    steps_at_s = np.inf

    def begin_trial(self, trial: int) -> None:
        """Draw whether and when."""
        self.steps_at_s = np.inf
        chance, when = self.random.random(), self.random.standard_normal()
        self.change = self["change"] if chance < self["share"] else 0.0
        self.at_s = self["time_s"] + self["scatter_s"] * float(np.clip(when, -2, 2))

    def drawn(self) -> dict[str, float]:
        """Return this trial's change, 0 where it has none, and its time, -1 before it has come."""
        return {"change": self.change, "time_s": self.steps_at_s if np.isfinite(self.steps_at_s) else -1.0}

    def sense(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Change the gain."""
        self.steps_at_s = max(self.at_s, block.touched_s + _AFTER_TOUCH_S)
        return force_mn * np.where(block.trial_time_s >= self.steps_at_s, 1 + self.change, 1.0)
