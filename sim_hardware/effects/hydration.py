"""The skin takes up water as the session goes on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Arm, Parts


class Hydration(Effect):
    """Wet skin relaxes more and later: its arms grow stiffer and slower from trial to trial, its spring softer.

    Shows in every contact as a trend over the session. Rough: it saturates over ``trials`` of them.
    """

    name = "hydration"
    stage = "tissue"
    in_library = False
    phases = IN_CONTACT
    parameters = (
        Parameter("change", "1", 0.5, -0.9, 5.0, "relative growth of the arms and their times in the end"),
        Parameter("trials", "1", 10.0, 1.0, 1000.0, "how many trials it takes"),
    )
    trial = -1

    def begin_trial(self, trial: int) -> None:
        """Count the trials."""
        self.trial = trial

    def fit(self, parts: Parts, *, skin: bool) -> Parts:
        """Soak the tissue; it is fitted before its trial begins."""
        if not skin:
            return parts
        done = (self.trial + 1) / self["trials"]
        wet = 1 + self["change"] * float(min(done, 1.0) + self.rough * (-np.expm1(-done) - min(done, 1.0)))
        arms = tuple(Arm(a.stiffness_mn_per_mm * wet, a.time_s * wet) for a in parts.arms)
        return replace(parts, k0_mn_per_mm=parts.k0_mn_per_mm / wet, arms=arms)
