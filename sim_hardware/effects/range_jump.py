"""The amplifier switches its range."""

from __future__ import annotations

import numpy as np
from numba import njit

from sim_hardware.effects.base import Effect, Parameter
from sim_hardware.parts import Block, FloatArray


@njit(cache=True)
def _switched(force: FloatArray, up: float, down: float, start: float) -> FloatArray:
    """Return 1 from where the force rises above ``up`` to where it falls below ``down``, else 0."""
    out = np.empty_like(force)
    state = start
    for i in range(force.shape[0]):
        if force[i] > up:
            state = 1.0
        elif force[i] < down:
            state = 0.0
        out[i] = state
    return out


class RangeJump(Effect):
    """Above a force the amplifier reads in its second range, whose zero is not that of the first.

    Shows in the ramp, the hold and the retract of trials that reach the force. Rough: it switches back 20 %
    lower than it switched over.
    """

    name = "range_jump"
    stage = "sensor"
    in_library = False
    phases = ("ramp", "hold", "retract")
    order = 72
    parameters = (
        Parameter("jump_mn", "mN", 3.0, -50.0, 50.0, "zero of the second range"),
        Parameter("level_mn", "mN", 60.0, 1.0, 700.0, "force at which it switches"),
    )
    range = 0.0

    def sense(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Switch the range."""
        level = self["level_mn"]
        second = _switched(force_mn, level, level * (1 - 0.2 * self.rough), self.range)
        if len(second):
            self.range = float(second[-1])
        return force_mn + self["jump_mn"] * second
