"""A bridge of sweat pulls at the punch."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Block


class SweatMeniscus(Effect):
    """Sweat wets the punch at the first touch and pulls it down; the bridge stretches and breaks.

    Shows as a sudden pull on landing, a constant one while in contact, and one that fades over the bridge's
    length after the skin is left: below zero far out of contact in the retract, where adhesion has ended.
    """

    name = "sweat_meniscus"
    stage = "contact"
    in_library = False
    phases = (*IN_CONTACT, "clear")
    parameters = (
        Parameter("pull_mn", "mN", 2.0, 0.0, 50.0, "pull of the bridge in contact"),
        Parameter("length_um", "um", 250.0, 1.0, 2000.0, "gap at which it breaks"),
    )
    bridged = False

    def begin_trial(self, trial: int) -> None:
        """Wipe the punch."""
        self.bridged = False

    def touch(self, block: Block) -> None:
        """Let the bridge pull."""
        if not block.skin or not len(block.fine_gap_mm):
            return
        length_mm = self["length_um"] * 1e-3
        gap = block.fine_gap_mm
        event = np.where(gap >= 0, 1, np.where(gap < -length_mm, -1, 0))
        last = np.maximum.accumulate(np.where(event != 0, np.arange(len(gap)), -1))
        bridged = np.where(last >= 0, event[np.maximum(last, 0)] > 0, self.bridged)
        self.bridged = bool(bridged[-1])
        fade = 1 - np.clip(-gap / length_mm, 0.0, 1.0)
        block.fine_force_mn = block.fine_force_mn - np.where(bridged, self["pull_mn"] * fade, 0.0)
