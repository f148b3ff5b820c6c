"""The tissue has not forgotten the previous indentation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Memory, Parts


class IncompleteRecovery(Effect):
    """Fluid pressed out by one indentation has not all flowed back when the next begins.

    Shows in every contact but the first, the more the deeper the previous one and the shorter the rest; the
    trial's own relaxation is the baseline's. The tissue sets with the time of its slow arm while it is
    pressed and recovers with ``time_constant_s``, on through the rests; ``fraction`` is what the force lacks
    per k0 and previous depth right after it. Rough: a neighbouring site feels it more or less, by 15 %.
    """

    name = "incomplete_recovery"
    stage = "tissue"
    in_library = True
    phases = IN_CONTACT
    parameters = (
        Parameter("fraction", "1", 0.3, -5.0, 50.0, "force lacking per k0 and previous depth"),
        Parameter("time_constant_s", "s", 60.0, 0.5, 5000.0, "time of the recovery"),
    )

    def fit(self, parts: Parts, *, skin: bool) -> Parts:
        """Give the tissue its memory."""
        if not skin:
            return parts
        setting_s = max((a.time_s for a in parts.arms[:2]), default=2.0)
        spread = 0.15 * self.rough * float(np.clip(self.random.standard_normal(), -2, 2))
        memory = Memory(self["fraction"] * parts.k0_mn_per_mm, setting_s, self["time_constant_s"], 1 + spread)
        return replace(parts, memory=memory)
