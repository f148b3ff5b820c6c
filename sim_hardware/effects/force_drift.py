"""The force's zero drifts as the electronics warm."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import ALWAYS, Effect, Parameter
from sim_hardware.parts import Block, FloatArray

_USUAL_S = 10.0


class ForceDrift(Effect):
    """F gains a slow drift from the start of the trial, contact or not.

    Shows in every phase, most in the later ones; the zero is taken anew before each trial. Rough: the drift
    curves, with the time ``bend_s`` (its mean over 10 s is the declared rate), and its rate differs by 10 %
    from trial to trial.
    """

    name = "force_drift"
    stage = "sensor"
    in_library = True
    phases = ALWAYS
    parameters = (
        Parameter("rate_mn_per_s", "mN/s", 0.2, -50.0, 50.0, "mean rate of the drift over 10 s"),
        Parameter("bend_s", "s", 40.0, 2.0, 1e4, "time in which the drift bends"),
    )
    order = 20
    share: float = 1.0

    def begin_trial(self, trial: int) -> None:
        """Draw this trial's rate."""
        self.share = 1 + 0.1 * self.rough * float(np.clip(self.random.standard_normal(), -2, 2))

    def drawn(self) -> dict[str, float]:
        """Return this trial's rate."""
        return {"rate_mn_per_s": self["rate_mn_per_s"] * self.share}

    def sense(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Add the drift."""
        t, bend_s = np.maximum(block.trial_time_s, 0.0), self["bend_s"]
        curved = np.asarray(np.expm1(-t / bend_s) * (_USUAL_S / np.expm1(-_USUAL_S / bend_s)))
        return force_mn + self["rate_mn_per_s"] * self.share * (t + self.rough * (curved - t))
