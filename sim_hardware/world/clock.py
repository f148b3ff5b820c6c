"""When the present trial began."""

from __future__ import annotations

import math

import numpy as np

from sim_hardware.parts import SAMPLE_RATE_HZ, FloatArray

_STILL = round(0.05 * SAMPLE_RATE_HZ)
_LONG_AGO = -(10**9)


class TrialClock:
    """The index at which the trial began: told, or seen.

    Nobody tells a bench that a recording has begun. It takes the last time the arm set off from rest before
    it first touched what was placed: the start of the approach, or of a sweep.
    """

    def __init__(self) -> None:
        self.start: int | None = None
        self.waiting = True
        self.touch: int | None = None
        self._moved_at = _LONG_AGO

    def reset(self) -> None:
        """Something new lies under the arm."""
        self.start, self.touch, self.waiting, self._moved_at = None, None, True, _LONG_AGO

    def begin(self, index: int) -> None:
        """The trial begins now, whatever the arm does."""
        self.start, self.touch, self.waiting = index, None, False

    def touched(self, index: int) -> None:
        """The arm has touched: it can set off no more."""
        self.touch, self.waiting = index, False

    @property
    def touched_s(self) -> float:
        """Trial time of the first touch, s; infinite before."""
        if self.touch is None or self.start is None:
            return math.inf
        return (self.touch - self.start) / SAMPLE_RATE_HZ

    def cut(self, first: int, command_v: FloatArray, before_v: float) -> list[tuple[int, bool]]:
        """Return where pieces of a command begin, and whether the arm sets off there."""
        if not self.waiting or not len(command_v):
            return [(0, False)]
        moves = np.flatnonzero(np.diff(command_v, prepend=before_v))
        if not len(moves):
            return [(0, False)]
        still = np.diff(moves + first, prepend=self._moved_at) > _STILL
        self._moved_at = first + int(moves[-1])
        starts = [int(m) for m in moves[still]]
        quiet = [] if starts and starts[0] == 0 else [(0, False)]
        return [*quiet, *((s, True) for s in starts)]
