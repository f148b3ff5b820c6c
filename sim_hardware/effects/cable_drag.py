"""The sensor's cable is dragged along."""

from __future__ import annotations

import numpy as np
from numba import njit

from sim_hardware.effects.base import IN_MOTION, Effect, Parameter
from sim_hardware.parts import Block, FloatArray

_PLAYS_MM = (0.15, 0.4, 1.0, 2.5)


@njit(cache=True)
def _plays(position: FloatArray, plays: FloatArray, at: FloatArray) -> FloatArray:
    """Return the mean of springs that each slide once stretched by their play (Prandtl-Ishlinskii)."""
    out = np.zeros_like(position)
    for i in range(position.shape[0]):
        for j in range(plays.shape[0]):
            at[j] = min(max(at[j], position[i] - plays[j]), position[i] + plays[j])
            out[i] += (position[i] - at[j]) / plays[j]
        out[i] /= plays.shape[0]
    return out


class CableDrag(Effect):
    """A stiff cable hangs on the arm: its strands stretch and then slide over each other.

    Shows from the start of any motion, contact or not, as a force that grows over tenths of a millimetre to
    millimetres, stays at rest, and takes another way back: hysteresis over travel, not over speed. The
    springs slide at 0.15, 0.4, 1 and 2.5 mm. Textbook: one spring that slides at 0.4 mm.
    """

    name = "cable_drag"
    stage = "lever"
    in_library = False
    phases = (*IN_MOTION, "dwell", "hold", "clear")
    parameters = (Parameter("drag_mn", "mN", 4.0, 0.0, 50.0, "drag with all strands sliding"),)
    at_mm: FloatArray | None = None

    def sense_fine(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Add the drag."""
        plays = np.array(_PLAYS_MM if self.rough else _PLAYS_MM[1:2])
        x = block.fine_position_mm
        if self.at_mm is None:
            self.at_mm = np.full(len(plays), x[0] if len(x) else 0.0)
        drag: FloatArray = self["drag_mn"] * _plays(x, plays, self.at_mm)
        return force_mn + drag
