"""The glue that holds the punch creeps."""

from __future__ import annotations

from dataclasses import replace

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Parts


class GlueCreep(Effect):
    """A layer of soft glue between arm and punch: a spring beside a dashpot, in series with the specimen.

    Shows in the hold as a force that falls with the glue's time while the motor stands, on skin and on the
    stiff block alike, and as a punch that comes back late in the retract.
    """

    name = "glue_creep"
    stage = "lever"
    in_library = False
    phases = IN_CONTACT
    parameters = (
        Parameter("creep_um_per_mn", "um/mN", 0.3, 0.0, 10.0, "how far the glue gives in the end"),
        Parameter("time_constant_s", "s", 0.6, 0.01, 1000.0, "its time"),
    )

    def fit(self, parts: Parts, *, skin: bool) -> Parts:
        """Put the glue in."""
        return replace(
            parts,
            creep_compliance_mm_per_mn=parts.creep_compliance_mm_per_mn + self["creep_um_per_mn"] * 1e-3,
            creep_time_s=self["time_constant_s"],
        )
