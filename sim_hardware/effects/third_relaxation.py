"""The tissue has a third time."""

from __future__ import annotations

from dataclasses import replace

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Arm, Parts


class ThirdRelaxation(Effect):
    """A third Maxwell arm.

    Shows in every contact, about one time constant after every change of depth. Rough: the time is a little
    band, two arms at 0.75 and 1.33 of it.
    """

    name = "third_relaxation"
    stage = "tissue"
    in_library = True
    phases = IN_CONTACT
    parameters = (
        Parameter("ratio_to_k0", "1", 0.15, -0.5, 20.0, "stiffness of the arm over k0"),
        Parameter("time_constant_s", "s", 0.02, 1e-4, 1000.0, "its time"),
    )

    def fit(self, parts: Parts, *, skin: bool) -> Parts:
        """Put the arm in."""
        if not skin:
            return parts
        k = self["ratio_to_k0"] * parts.k0_mn_per_mm
        spread = (4 / 3) ** self.rough
        arms = (Arm(k / 2, self["time_constant_s"] / spread), Arm(k / 2, self["time_constant_s"] * spread))
        return replace(parts, arms=(*parts.arms, *arms))
