"""Ctrl-C: the first asks for a clean stop, any further one only says that the arm is still on its way."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType, TracebackType
from typing import Any, Self

STOPPED = "stopped by the operator"


class Interrupted(KeyboardInterrupt):
    """The operator asked to stop; the command line turns it into exit code 130."""


class Interrupts:
    """Turns SIGINT and SIGTERM into a request that the engine meets between two reads.

    A call to the card is never torn apart by a signal. While the program only waits for a hand or for time
    (`waiting`), the signal ends the wait at once. Outside the main thread, signals are left alone.
    """

    def __init__(self) -> None:
        self._asked = False
        self._waiting = False
        self._shields = 0
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            hangup = getattr(signal, "SIGHUP", None)  # the terminal is gone; Windows knows none
            for kind in (signal.SIGINT, signal.SIGTERM, *([hangup] if hangup else [])):
                self._before[kind] = signal.signal(kind, self._on_signal)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def request(self) -> None:
        """Ask for a stop, as Ctrl-C does; from any thread."""
        self._asked = True

    def check(self) -> None:
        """Raise Interrupted where a stop was asked for."""
        if self._asked and not self._shields:
            raise Interrupted(STOPPED)

    @contextmanager
    def waiting(self) -> Iterator[None]:
        """Let a signal end what is inside at once: a prompt, a rest."""
        self.check()
        self._waiting = True
        try:
            yield
        finally:
            self._waiting = False

    @contextmanager
    def shielded(self) -> Iterator[None]:
        """Let nothing interrupt what is inside: the way clear of the skin."""
        self._shields += 1
        try:
            yield
        finally:
            self._shields -= 1

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        again, self._asked = self._asked, True
        if self._waiting and not self._shields:
            self._waiting = False
            raise Interrupted(STOPPED)
        note = "still moving the arm clear" if again or self._shields else "stopping: moving the arm clear"
        with suppress(OSError):  # after a hangup nobody reads it
            print(f"\n{note} ...", file=sys.stderr, flush=True)
