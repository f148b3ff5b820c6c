"""The finger moves once."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import Effect, Parameter
from sim_hardware.parts import Block, FloatArray

_MOVE_S = 0.003
_AFTER_TOUCH_S = 1.0


class MotionArtefact(Effect):
    """In some trials the surface shifts once, towards the arm where positive, and stays shifted.

    Shows from the shift to the end of contact, in the trials that have it; it comes a second after the first
    touch at the earliest. The move takes some 15 ms. Rough:
    its size differs by 30 % from trial to trial and its time by ``scatter_s``, and it springs back by 5 %
    with half a second.
    """

    name = "motion_artefact"
    stage = "specimen"
    in_library = True
    phases = ("dwell", "ramp", "hold", "retract")
    parameters = (
        Parameter("shift_um", "um", 30.0, -1000.0, 1000.0, "how far the surface shifts"),
        Parameter("time_s", "s", 5.0, 0.0, 1000.0, "when, counted from the trial's start"),
        Parameter("share", "1", 0.4, 0.0, 1.0, "share of the trials that have it"),
        Parameter("scatter_s", "s", 1.0, 0.0, 5.0, "standard deviation of the time over trials"),
    )
    shift_um = 0.0
    at_s = 0.0
    moves_at_s = np.inf

    def begin_trial(self, trial: int) -> None:
        """Draw whether, when and how far."""
        chance, size, when = self.random.random(), self.random.random(), self.random.standard_normal()
        self.moves_at_s = np.inf
        self.shift_um = 0.0
        if chance < self["share"]:
            self.shift_um = self["shift_um"] * (1 + 0.3 * self.rough * (2 * size - 1))
        self.at_s = self["time_s"] + self.rough * self["scatter_s"] * float(np.clip(when, -2, 2))

    def drawn(self) -> dict[str, float]:
        """Return this trial's shift, 0 where it has none, and its time, -1 before it has come."""
        return {
            "shift_um": self.shift_um,
            "time_s": self.moves_at_s if np.isfinite(self.moves_at_s) else -1.0,
        }

    def surface_mm(self, block: Block) -> FloatArray:
        """Return the shift."""
        self.moves_at_s = max(self.at_s, block.touched_s + _AFTER_TOUCH_S)
        since = block.trial_time_s - self.moves_at_s
        moved = 0.5 * (1 + np.tanh(since / _MOVE_S / 2))
        back = 0.05 * self.rough * -np.expm1(-np.maximum(since, 0.0) / 0.5)
        return self.shift_um * 1e-3 * moved * (1 - back)
