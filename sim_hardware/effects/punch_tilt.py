"""The punch tips from one seat to the other."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Block

_TIP_S = 0.004
_LONGEST_S = 600.0


class PunchTilt(Effect):
    """A punch that is a little loose tips between two poses, at random and back again.

    Shows in contact as a force that is multiplied by 1 or by less, in turns, several times a trial. Rough: a
    pose is reached over 4 ms, and how much is lost differs by 20 % from turn to turn.
    """

    name = "punch_tilt"
    stage = "contact"
    in_library = False
    phases = IN_CONTACT
    parameters = (
        Parameter("loss", "1", 0.03, 0.0, 0.9, "share of the force lost in the second pose"),
        Parameter("rate_hz", "Hz", 0.5, 0.01, 20.0, "turns per second"),
    )

    def begin_trial(self, trial: int) -> None:
        """Draw when it tips, and how far."""
        n = max(int(_LONGEST_S * self["rate_hz"]), 1)
        self.turns_s = np.cumsum(self.random.exponential(1 / self["rate_hz"], n))
        losses = 1 + 0.2 * self.rough * np.clip(self.random.standard_normal(n + 1), -2, 2)
        second = (np.arange(n + 1) + int(self.random.integers(2))) % 2
        self.losses = self["loss"] * losses * second

    def touch(self, block: Block) -> None:
        """Lose the force of the second pose."""
        if not block.skin:
            return
        time = block.fine_trial_time_s
        turn = np.searchsorted(self.turns_s, time, side="right")
        lost = self.losses[turn]
        if self.rough:
            since = time - np.concatenate([[-np.inf], self.turns_s])[turn]
            before = self.losses[np.maximum(turn - 1, 0)]
            lost = lost + (before - lost) * np.exp(-since / (_TIP_S * self.rough))
        block.fine_force_mn = block.fine_force_mn * (1 - lost)
