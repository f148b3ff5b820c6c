"""The second guard: brings the arm to safety where the first guard can't, and is idle otherwise.

On stdin, from the first guard: the orders, then the program's words and "alive", "moving", "safe", "end". It
acts when the first guard is dead or silent with the arm away, at once where the program is dead as well, else
after the time in which the program, told by the first guard's silence, brings the arm to safety itself. It loads
the driver's client only then.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import sys
import threading
import time
from typing import Any

import psutil

from rig.hardware.telling import tell_person

_LOOK_S = 0.05
_MOVING_S = 12.0
"""The first guard, once it moves the arm, is given so long."""

_PROGRAM_S = 3.0
"""A living program, told by the first guard's silence, is given so long to bring the arm to safety."""


def main() -> int:
    """Run the second guard; 0 after an orderly end or a successful retreat, 1 where the arm could not be moved."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    orders = json.loads(sys.stdin.buffer.readline())
    words: queue.SimpleQueue[str | None] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(words,), daemon=True).start()
    return _Second(orders, words).until_the_end()


def _listen(words: queue.SimpleQueue[str | None]) -> None:
    for line in sys.stdin.buffer:
        words.put(line.decode().strip())
    words.put(None)


def runs(pid: int, started_s: float | None = None) -> bool:
    """Whether a process runs, is no corpse, and (``started_s``, s since 1970) is the one that was meant."""
    try:
        process = psutil.Process(pid)
        same = started_s is None or abs(process.create_time() - started_s) < 1.0
        return same and process.status() not in {psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD}
    except psutil.Error:
        return False


class _Second:
    def __init__(self, orders: dict[str, Any], words: queue.SimpleQueue[str | None]) -> None:
        self._orders = orders
        self._words = words
        self._away: list[float] | None = None
        self._heard_s = time.monotonic()
        self._patience_s = max(2 * orders["rig"]["guard"]["heartbeat_timeout_s"], 1.0)
        self._gone = self._ended = False

    def until_the_end(self) -> int:
        """Watch the first guard until its end; the exit code."""
        first, program = os.getppid(), int(self._orders["program"])
        looked_s = time.monotonic()
        failed_s: float | None = None
        while True:
            self._hear()
            if self._ended:
                return 0
            now_s = time.monotonic()
            if now_s - looked_s > self._patience_s / 2:
                self._heard_s = now_s  # this process stood still itself
            looked_s = now_s
            failed = self._gone or now_s - self._heard_s > self._patience_s
            if not failed:
                failed_s = None
                continue
            failed_s = now_s if failed_s is None else failed_s
            program_dead = not runs(program)
            if self._away is None:
                if program_dead or self._gone:
                    return 0
            elif program_dead or now_s - failed_s > _PROGRAM_S:
                return self._take_over(first, None if program_dead else program)

    def _hear(self) -> None:
        try:
            word = self._words.get(timeout=_LOOK_S)
            while True:
                self._take(word)
                word = self._words.get_nowait()
        except queue.Empty:
            return

    def _take(self, word: str | None) -> None:
        if word is None:
            self._gone = True
            return
        self._heard_s = time.monotonic()
        kind, *values = word.split()
        if kind == "away":
            self._away = [float(value) for value in values]
        elif kind == "safe":
            self._away = None
        elif kind == "moving":
            self._heard_s += _MOVING_S
        elif kind == "end":
            self._ended = True

    def _take_over(self, first: int, program: int | None) -> int:
        tell_fd = self._orders["tell_fd"]
        tell_person(
            tell_fd, "the guard is gone with the arm in use: LIFT IT BY HAND unless this says it is clear"
        )
        if not self._gone:
            # it has not moved the arm, and would hold the card
            with contextlib.suppress(ProcessLookupError):
                os.kill(first, signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL)
        from rig.hardware.guard_process import card_of, move, to_safety_with
        from rig.hardware.retreat import Bearings

        assert self._away is not None
        with card_of(self._orders) as card:
            code = move(
                "the guard is gone",
                to_safety_with(card, self._orders),
                Bearings(*self._away),
                program=program,
                tell_fd=tell_fd,
            )
        if code == 0:
            tell_person(tell_fd, "the arm is clear")
        return code


if __name__ == "__main__":
    sys.exit(main())
