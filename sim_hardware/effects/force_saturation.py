"""The force amplifier runs out of range."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import Effect, Parameter
from sim_hardware.parts import Block, FloatArray


class ForceSaturation(Effect):
    """F is cut above a level.

    Shows in the ramp, the hold and the retract of trials that reach the level. Rough: it bends over a knee of
    1.5 mN and keeps 15 % of its rise above.
    """

    name = "force_saturation"
    stage = "sensor"
    in_library = True
    phases = ("ramp", "hold", "retract")
    order = 70
    parameters = (Parameter("level_mn", "mN", 100.0, 1.0, 700.0, "force above which the reading is bent"),)

    def sense(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Return the bent force."""
        over = force_mn - self["level_mn"]
        if self.rough == 0:
            return force_mn - np.maximum(over, 0.0)
        knee = 1.5 * self.rough
        soft = knee * np.logaddexp(0.0, over / knee)
        return force_mn - (1 - 0.15 * self.rough) * np.asarray(soft)
