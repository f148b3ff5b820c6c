"""The skin clings to the punch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim_hardware.effects.base import Effect, Parameter
from sim_hardware.parts import Parts

_PEEL_MM = 0.0006


class Adhesion(Effect):
    """On the retract F goes below zero before contact is lost.

    Shows at the end of the retract, from where the force would reach zero. Rough: the bond does not hold
    rigidly and snap; it opens and peels from the rim, gripping harder up to an opening of 0.6 um, and its
    viscous front adds ``front_s_per_mm`` of its strength per speed; its strength differs by 3 % from site to
    site.
    """

    name = "adhesion"
    stage = "contact"
    in_library = True
    phases = ("retract",)
    parameters = (
        Parameter("pull_off_mn", "mN", 4.2, 0.0, 200.0, "largest pull before contact is lost"),
        Parameter("front_s_per_mm", "s/mm", 0.008, 0.0, 0.2, "viscosity of the peeling front, over the pull"),
    )
    pull_off_mn = 0.0

    def fit(self, parts: Parts, *, skin: bool) -> Parts:
        """Make the skin cling."""
        if not skin:
            return parts
        spread = 0.03 * self.rough * float(np.clip(self.random.standard_normal(), -2, 2))
        self.pull_off_mn = self["pull_off_mn"] * (1 + spread)
        return replace(
            parts,
            pull_off_mn=self.pull_off_mn,
            peel_mm=_PEEL_MM * self.rough,
            peel_mn_s_per_mm=self["front_s_per_mm"] * self.rough * self.pull_off_mn,
        )

    def drawn(self) -> dict[str, float]:
        """Return this site's strength."""
        return {"pull_off_mn": self.pull_off_mn}
