"""The punch slips on the skin."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import Effect, Parameter
from sim_hardware.parts import Block, FloatArray

_SLIDE_S = 0.0015
_STICK_S = 0.03
_STICK = 0.06
_LOADED_MN = 20.0
_AFTER_LOAD_S = 0.5


class Slip(Effect):
    """The force on the punch drops within milliseconds, once, in the hold.

    Shows from the slip to the end of contact; it comes half a second after 20 mN were reached at the
    earliest. The edge of the punch slides off a ridge: a share of the
    bearing area is lost, so that the force stays lower in proportion until the punch leaves. Rough: 6 % is
    won back within 30 ms as the skin sticks again; the time differs from trial to trial by ``scatter_s``.
    """

    name = "slip"
    stage = "contact"
    in_library = True
    phases = ("hold", "retract")
    parameters = (
        Parameter("drop_mn", "mN", 3.0, 0.0, 200.0, "how far the force drops in the end"),
        Parameter("time_s", "s", 6.0, 0.0, 1000.0, "when, counted from the trial's start"),
        Parameter("scatter_s", "s", 0.5, 0.0, 5.0, "standard deviation of the time over trials"),
    )
    lost = -1.0  # share of the force that is lost, -1 before the slip
    at_s = 0.0
    loaded_s = np.inf
    over = False

    def begin_trial(self, trial: int) -> None:
        """Draw when it slips."""
        scatter = self["scatter_s"] * self.rough * float(np.clip(self.random.standard_normal(), -2, 2))
        self.at_s, self.lost, self.over = self["time_s"] + scatter, -1.0, False
        self.loaded_s = np.inf

    def drawn(self) -> dict[str, float]:
        """Return when it slips."""
        return {"time_s": self.at_s}

    def touch(self, block: Block) -> None:
        """Take the lost share off the force."""
        if not block.skin or self.over:
            return
        time, force = block.fine_trial_time_s, block.fine_force_mn
        if self.loaded_s == np.inf:
            loaded = np.flatnonzero((force > _LOADED_MN) & (time >= 0))
            if not len(loaded):
                return
            self.loaded_s = float(time[loaded[0]])
            self.at_s = max(self.at_s, self.loaded_s + _AFTER_LOAD_S)
        since = time - self.at_s
        started = np.flatnonzero(since >= 0)
        if not len(started):
            return
        if self.lost < 0:
            at = float(force[started[0]])
            self.lost = min(self["drop_mn"] / at, 1.0) if at > 0 else 0.0
        left = np.flatnonzero((force <= 0) & (since >= 0))
        stop = len(force)
        if len(left):
            stop, self.over = int(left[0]), True
        share = np.where(since[:stop] >= 0, self.lost * self._course(since[:stop]), 0.0)
        block.fine_force_mn = np.concatenate([force[:stop] * (1 - share), force[stop:]])

    def _course(self, since: FloatArray) -> FloatArray:
        """Return how much of the drop has come: 1 in the end, a little more just after the slip."""
        t = np.maximum(since, 0.0)
        again = _STICK * self.rough * np.exp(-t / _STICK_S)
        return np.asarray(-np.expm1(-t / _SLIDE_S) * (1 + again))
