"""Time is asked of a clock: the system's, or the bench's own, which may run as fast as it can."""

from __future__ import annotations

import time
from typing import Protocol

from rig.hardware.errors import OperatorError
from rig.hardware.remote import ControlService


class Clock(Protocol):
    """Where time comes from."""

    def time_s(self) -> float:
        """Time since some fixed moment, s; never goes back."""

    def sleep(self, duration_s: float) -> None:
        """Let so much time pass, s; may be interrupted by Ctrl-C."""


class SystemClock:
    """The computer's own clock."""

    def time_s(self) -> float:
        """Monotonic time, s."""
        return time.monotonic()

    def sleep(self, duration_s: float) -> None:
        """Wait, s."""
        time.sleep(max(duration_s, 0.0))


class RemoteClock:
    """The clock of a control service; ``sleep`` returns when its time has passed, however fast that is."""

    _LONGEST_S = 1.0
    """A real-time service holds the call so long at most, so that Ctrl-C is heard."""

    def __init__(self, service: ControlService) -> None:
        self._service = service

    def time_s(self) -> float:
        """The service's time, s."""
        answer = self._service.call("time_s")
        if not isinstance(answer, float | int):
            raise OperatorError(f"control service {self._service.address}: time_s is no number: {answer!r}")
        return float(answer)

    def sleep(self, duration_s: float) -> None:
        """Let the service's time pass, s."""
        if duration_s <= 0:
            return
        self._service.call("sleep", float(duration_s))
