"""The tissue resists the speed of its deformation."""

from __future__ import annotations

from dataclasses import replace

from sim_hardware.effects.base import Effect, Parameter
from sim_hardware.parts import Arm, Parts

_BUILD_UP_S = 5e-5


class ParallelDashpot(Effect):
    """F gains c dd/dt while in contact.

    Shows while the punch moves in contact: from landing to the stop, in the ramp, in the retract. Rough: the
    viscous force takes 50 us to build up.
    """

    name = "parallel_dashpot"
    stage = "tissue"
    in_library = True
    phases = ("approach", "ramp", "retract")
    parameters = (
        Parameter("coefficient_mn_s_per_mm", "mN s/mm", 0.5, 0.0, 50.0, "force per speed in contact"),
    )

    def fit(self, parts: Parts, *, skin: bool) -> Parts:
        """Put the dashpot in."""
        if not skin:
            return parts
        c = self["coefficient_mn_s_per_mm"]
        if self.rough == 0:
            return replace(parts, dashpot_mn_s_per_mm=parts.dashpot_mn_s_per_mm + c)
        time_s = _BUILD_UP_S * self.rough
        return replace(parts, arms=(*parts.arms, Arm(c / time_s, time_s)))
