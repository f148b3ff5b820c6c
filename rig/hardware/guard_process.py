"""The guard's own process: waits for the program's death and then moves the arm to the safe position.

On stdin: one JSON line of orders, then words, one a line: "away LOW HIGH SAFE" (where the output may be and
where the arm is safe, V), "safe", "beat engine", "beat reader", "end". The second guard has them from the program
itself where a process can be handed a pipe, else from here. On stdout "alive", again and again, or "alone" where
the second guard is dead. A pipe that closes without "end", a parent that is gone, or an engine or
reader that is silent while the arm is away mean that nobody else will move it. `reset_device()` would not: an S
Series output keeps its voltage.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rig.hardware.hearing import Ear, first_line
from rig.hardware.processes import ask_for_priority, own_session
from rig.hardware.retreat import Bearings
from rig.hardware.taking_over import ToSafety, card_of, move, to_safety_with
from rig.settings.rig_file import GuardSettings

_log = logging.getLogger("guard")

_STDIN = 0

_LOOK_S = 0.02
"""How often the parent is looked at, beside the pipe."""

_REPORT_S = 0.1

_BEATING = ("engine", "reader")


def main() -> int:
    """Run the guard; 0 after an orderly end or a successful retreat, 1 where the arm could not be moved."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    ask_for_priority()
    line = first_line(_STDIN)
    orders = json.loads(line)
    settings = GuardSettings.model_validate_json(json.dumps(orders["rig"]["guard"]))
    _log_to(settings.log_file)
    with card_of(orders) as card:
        card.connect()
        second = _Second(line, orders["hold_open"], orders["ear_fd"])
        ear = Ear()
        ear.listen(_STDIN, "program")
        print("ready", second.pid, flush=True)
        watch = Watch(
            ear,
            second,
            orders,
            heartbeat_timeout_s=settings.heartbeat_timeout_s,
            to_safety=to_safety_with(card, orders),
            free=card.clear_left_over_tasks,
        )
        code = watch.until_the_end()
        # where the arm could not be moved, the person has been told: a second one could not either
        second.say("end")
        return code


class _Second:
    """The second guard: hears that this one lives, and what this one hears unless it has an ear of its own."""

    def __init__(self, orders: bytes, hold_open: list[int], ear_fd: int | None) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "rig.hardware.second_guard"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            bufsize=0,
            **own_session(hold_open),
        )
        if ear_fd is not None:
            os.close(ear_fd)  # with the second guard alone: its death breaks the pipe
        self.pid = self._process.pid
        self.hears_program = ear_fd is not None
        self._write(orders)
        assert self._process.stdin is not None
        if sys.platform != "win32":
            os.set_blocking(self._process.stdin.fileno(), False)

    @property
    def alive(self) -> bool:
        """Whether its process runs."""
        return self._process.poll() is None

    def say(self, words: str) -> None:
        """Pass words on; where it is gone, `alive` says so."""
        self._write(words.encode() + b"\n")

    def _write(self, line: bytes) -> None:
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.write(line)


class Watch:
    """What the guard knows of the program, and what it does about it."""

    def __init__(
        self,
        ear: Ear,
        second: _Second,
        orders: dict[str, Any],
        *,
        heartbeat_timeout_s: float,
        to_safety: ToSafety,
        free: Callable[[], None],
    ) -> None:
        self._ear = ear
        self._second = second
        self._orders = orders
        self._timeout_s = heartbeat_timeout_s
        self._to_safety = to_safety
        self._free = free
        self._bearings: Bearings | None = None
        """Where the output may be while the arm is away; None while it is safe."""
        self._heard_s = dict.fromkeys(_BEATING, time.monotonic())
        self._reported_s = 0.0
        self._ended = False
        self._gone = False

    def until_the_end(self) -> int:
        """Watch until the program ends, or is gone and the arm safe; the exit code."""
        parent = os.getppid()
        looked_s = time.monotonic()
        while True:
            self._hear()
            if self._ended:
                return 0
            # the pipe stays open while any process forked by the program lives
            dead = self._gone or os.getppid() != parent
            now_s = time.monotonic()
            if now_s - looked_s > self._timeout_s / 2:
                # the guard stood still itself: what was said meanwhile is heard first
                self._heard_s = dict.fromkeys(_BEATING, now_s)
            looked_s = now_s
            self._report(now_s)
            if dead and self._bearings is None:
                _log.info("the program is gone, the arm is safe: freeing the card")
                self._free()
                return 0
            if dead:
                return self._move("the program is gone", program=None)
            silent = [who for who in _BEATING if now_s - self._heard_s[who] > self._timeout_s]
            if self._bearings is not None and silent:
                why = f"no sign of life of the {' and the '.join(silent)} for {self._timeout_s:g} s"
                silent_s = now_s - min(self._heard_s[who] for who in silent)
                self._move(why, program=self._orders["program"], silent_s=silent_s)
                self._bearings = None

    def _hear(self) -> None:
        """Take in all words that have come, waiting a little for the first."""
        for _, word in self._ear.heard(_LOOK_S):
            self._take(word)

    def _take(self, word: str | None) -> None:
        if word is None:
            self._gone = True
            return
        if not self._second.hears_program:
            self._second.say(word)
        kind, *values = word.split()
        if kind == "beat":
            self._heard_s[values[0]] = time.monotonic()
        elif kind == "away":
            if self._bearings is None:
                self._heard_s = dict.fromkeys(_BEATING, time.monotonic())
            self._bearings = Bearings(*(float(value) for value in values))
        elif kind == "safe":
            self._bearings = None
        elif kind == "end":
            self._ended = True

    def _report(self, now_s: float) -> None:
        """Say to the program and to the second guard that this one lives."""
        if now_s - self._reported_s < _REPORT_S:
            return
        self._reported_s = now_s
        self._second.say("alive")
        with contextlib.suppress(OSError):
            print("alive" if self._second.alive else "alone", flush=True)

    def _move(self, why: str, *, program: int | None, silent_s: float = 0.0) -> int:
        self._second.say("moving")
        code = move(
            why,
            self._to_safety,
            self._bearings,
            program=program,
            tell_fd=self._orders["tell_fd"],
            sentinel_fd=self._orders["sentinel_fd"],
            silent_s=silent_s,
        )
        if code == 0:
            self._second.say("moved")
        return code


def _log_to(file: str | None) -> None:
    from platformdirs import user_log_path

    path = Path(file) if file is not None else user_log_path("indenter", ensure_exists=True) / "guard.log"
    logging.basicConfig(
        filename=path, level=logging.INFO, format="%(asctime)s.%(msecs)03d %(message)s", datefmt="%F %T"
    )


if __name__ == "__main__":
    sys.exit(main())
