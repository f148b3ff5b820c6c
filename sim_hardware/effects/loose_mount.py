"""The punch sits loosely in its hole."""

from __future__ import annotations

from dataclasses import replace

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Parts


class LooseMount(Effect):
    """Play between arm and punch, taken up as the force seats it: give = play F / (F + seat).

    Shows at small forces: after landing, in the dwell, at the start of the ramp and the end of the retract;
    on a stiff target as well. At large forces it is but a shift.
    """

    name = "loose_mount"
    stage = "lever"
    in_library = False
    phases = IN_CONTACT
    parameters = (
        Parameter("play_um", "um", 15.0, 0.0, 500.0, "play"),
        Parameter("seat_mn", "mN", 8.0, 0.1, 500.0, "force that takes up half of it"),
    )

    def fit(self, parts: Parts, *, skin: bool) -> Parts:
        """Loosen the mount."""
        return replace(parts, slack_mm=self["play_um"] * 1e-3, slack_force_mn=self["seat_mn"])
