"""What the sensors say while nothing is recorded: shown to those who look on, and dropped."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Protocol

from rig.hardware.errors import HardwareError, LimitHit, RetreatFailedError
from rig.hardware.lever import Chunk, Lever

_log = logging.getLogger(__name__)

_LONGEST_S = 0.1
"""Read at once; more than that behind, the rest is taken in the next looks."""

_AFTER_FAULT_S = 2.0


class Idling(Protocol):
    """What is done while a run waits for a hand, for time, or for a person."""

    def look(self) -> None:
        """Do some of it; called again and again, and never waits long."""

    def end(self) -> None:
        """The arm is about to be used: leave it."""


class Nothing:
    """Nothing is done."""

    def look(self) -> None:
        """Do nothing."""

    def end(self) -> None:
        """Leave nothing."""


class LiveView:
    """Reads the arm at rest at the pace of the clock on the wall, so that a live view never stands still.

    `began` is told when samples begin to come, `follow` gets them. A knock against the resting arm that
    passes a limit is no fault: the arm is sent to the safe position, where it is, and looked at again.
    `trouble` says why nothing can be read now, and is empty where something was.
    """

    def __init__(self, lever: Lever, began: Callable[[], None], follow: Callable[[Chunk], None]) -> None:
        self._lever = lever
        self._began = began
        self._follow = follow
        self._since: float | None = None
        self._taken = 0
        self._not_before = 0.0
        self.trouble = ""

    def look(self) -> None:
        """Read what has come. Raises RetreatFailedError where the arm does not answer any more."""
        now = time.monotonic()
        if self._since is None:
            if now < self._not_before:
                return
            self._taken = 0
            try:
                self._lever.start_recording()
            except HardwareError as error:
                self._fault(error)
                return
            self._since = now
            self._began()
            return
        rate_hz = self._lever.sample_rate_hz
        due = max(round((now - self._since) * rate_hz), self._lever.acquired) - self._taken
        n = min(due, round(_LONGEST_S * rate_hz))
        if n <= 0:
            return
        try:
            chunk = self._lever.read(n)
        except RetreatFailedError:
            raise
        except LimitHit as hit:
            self._fault(hit)
            self._lever.retreat()
        except HardwareError as error:
            self._fault(error)
        else:
            self._taken += n
            self.trouble = ""
            self._follow(chunk)

    def end(self) -> None:
        """Stop reading."""
        if self._since is None:
            return
        self._since = None
        try:
            self._lever.stop_recording()
        except LimitHit as hit:
            self._fault(hit)
            self._lever.retreat()
        except HardwareError as error:
            self._fault(error)

    def _fault(self, error: HardwareError) -> None:
        _log.warning("the arm at rest: %s", error)
        self.trouble = " ".join(str(error).split())
        self._not_before = time.monotonic() + _AFTER_FAULT_S
        if self._since is not None:
            self._since = None
            try:
                self._lever.stop_recording()
            except HardwareError as more:
                _log.warning("the arm at rest: %s", more)
