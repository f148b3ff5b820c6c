"""The arm bends under the force."""

from __future__ import annotations

from dataclasses import replace

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Parts


class LeverCompliance(Effect):
    """The tip lags behind the motor by C F: the arm, its tube and the shaft bend.

    Shows wherever there is force, most on a stiff target; feeds back on the force itself. Rough: 3 % of the
    bending comes late, with 1 ms, as in any glued joint.
    """

    name = "lever_compliance"
    stage = "lever"
    in_library = True
    phases = IN_CONTACT
    parameters = (
        Parameter("compliance_um_per_mn", "um/mN", 0.5, 0.0, 10.0, "bending of the arm by a force"),
    )

    def fit(self, parts: Parts, *, skin: bool) -> Parts:
        """Put a spring between motor and tip."""
        compliance = self["compliance_um_per_mn"] * 1e-3
        late = 0.03 * self.rough * compliance
        return replace(
            parts,
            compliance_mm_per_mn=parts.compliance_mm_per_mn + compliance - late,
            creep_compliance_mm_per_mn=parts.creep_compliance_mm_per_mn + late,
            creep_time_s=1e-3 if late and not parts.creep_compliance_mm_per_mn else parts.creep_time_s,
        )
