"""The finger warms under the lamp and softens."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Block


class WarmingTissue(Effect):
    """Stiffness falls with bench time towards a warm value.

    Shows in every contact as a force that is smaller the later in the session the trial is, in proportion to
    the force itself.
    """

    name = "warming_tissue"
    stage = "tissue"
    in_library = False
    phases = IN_CONTACT
    parameters = (
        Parameter("softening", "1", 0.08, -0.9, 0.9, "share of the stiffness that is lost in the end"),
        Parameter("time_constant_s", "s", 1200.0, 1.0, 1e5, "time of the warming, from power-on"),
    )

    def touch(self, block: Block) -> None:
        """Soften the tissue."""
        if block.skin:
            warm = -np.expm1(-block.time_s / self["time_constant_s"])
            block.fine_force_mn = block.fine_force_mn * np.repeat(
                1 - self["softening"] * warm, block.substeps
            )
