"""Ctrl-C and requests to stop: heard at the next read, and at once where the program only waits."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType, TracebackType
from typing import Any, Self

from rig.hardware.telling import say_beside

STOPPED = "stopped by the operator"


class Interrupted(KeyboardInterrupt):
    """The operator asked to stop; the command line turns it into exit code 130."""


class CutShort(Exception):  # noqa: N818 - what happens to a trial, no error of the program
    """The operator asked for this trial to end now; the run goes on."""


class Interrupts:
    """Turns SIGINT, SIGTERM and requests from other threads into something the engine meets between two reads.

    A call to the card is never torn apart by a signal. While the program only waits for a device (`waiting`),
    a stop ends the wait at once; other waits are cut in slices with a `check` between them. Outside the main
    thread, signals are left alone.
    """

    def __init__(self) -> None:
        self.at_once: Callable[[], None] = lambda: None
        """Called as soon as something is asked for, by whoever asks; it must not wait."""
        self._asked = False
        self._cut_short = ""
        self._waiting = False
        self._shields = 0
        self._before: dict[signal.Signals, Any] = {}
        self._thread: int | None = None

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            self._thread = threading.get_ident()
            hangup = getattr(signal, "SIGHUP", None)  # the terminal is gone; Windows knows none
            for kind in (signal.SIGINT, signal.SIGTERM, *([hangup] if hangup else [])):
                self._before[kind] = signal.signal(kind, self._on_signal)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._thread = None
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def request(self) -> None:
        """Ask for a stop, as Ctrl-C does; from any thread."""
        self._asked = True
        self._act()
        self._wake()

    def request_cut(self, reason: str) -> None:
        """Ask for the end of the trial under way, not of the run; from any thread."""
        self._cut_short = reason
        self._act()

    def forget_cut(self) -> None:
        """Drop a request to end a trial: it has ended."""
        self._cut_short = ""

    def check(self) -> None:
        """Raise Interrupted where a stop was asked for, CutShort where the end of the trial was."""
        if self._shields:
            return
        if self._asked:
            raise Interrupted(STOPPED)
        if self._cut_short:
            reason, self._cut_short = self._cut_short, ""
            raise CutShort(reason)

    @contextmanager
    def waiting(self) -> Iterator[None]:
        """Let a stop end what is inside at once, wherever it waits: a stage that moves, a balance that settles."""
        self._waiting = True
        try:
            # after the flag: a request that came just before it has sent no signal
            self.check()
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

    def _act(self) -> None:
        if not self._shields:
            self.at_once()

    def _wake(self) -> None:
        """End a call that waits in the main thread; where the system has no such signals, it ends by itself."""
        thread = self._thread
        if thread is not None and self._waiting and thread != threading.get_ident() and os.name == "posix":
            signal.pthread_kill(thread, signal.SIGINT)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        again, self._asked = self._asked, True
        self._act()
        if self._waiting and not self._shields:
            self._waiting = False
            raise Interrupted(STOPPED)
        note = "still moving the arm clear" if again or self._shields else "stopping: moving the arm clear"
        say_beside(f"{note} ...")  # a held terminal would hold up the way clear
