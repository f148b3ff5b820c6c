"""What the specimen lies on rings."""

from __future__ import annotations

import math
from dataclasses import replace

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Parts


class SupportResonance(Effect):
    """Stage and support are a mass on a spring, hardly damped, under finger or block.

    Shows as ringing of the force after every change of speed in contact, the start and the end of the ramp
    and the start of the retract, and as a support that sinks a little under load.
    """

    name = "support_resonance"
    stage = "specimen"
    in_library = False
    phases = IN_CONTACT
    parameters = (
        Parameter("frequency_hz", "Hz", 60.0, 5.0, 1000.0, "frequency of the loaded support"),
        Parameter("mass_g", "g", 10.0, 0.5, 5000.0, "its mass"),
        Parameter("damping_ratio", "1", 0.03, 0.001, 1.0, "its damping ratio"),
    )

    def fit(self, parts: Parts, *, skin: bool) -> Parts:
        """Put the support in."""
        stiffness = self["mass_g"] * 1e-3 * (2 * math.pi * self["frequency_hz"]) ** 2
        return replace(
            parts,
            support_mass_g=self["mass_g"],
            support_mn_per_mm=stiffness,
            support_damping_ratio=self["damping_ratio"],
        )
