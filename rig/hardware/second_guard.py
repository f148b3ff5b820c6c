"""The second guard: brings the arm to safety where nobody else does, and is idle otherwise.

On stdin, from the first guard: the orders, then "alive", "moving", "moved", "end". By a pipe of its own, from the
program: what the first guard is told. It acts when the first guard is dead or silent with the arm away: at once
where the program is dead or silent as well, else after the time in which the program, told by the first guard's
silence, brings the arm to safety itself. Whatever it is, the person is told within a second. It loads the driver's
client only then.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
import time
from typing import Any

from rig.hardware.hearing import Ear, first_line
from rig.hardware.processes import ask_for_priority, runs
from rig.hardware.telling import tell_person

_STDIN = 0

_LOOK_S = 0.05
_MOVING_S = 12.0
"""The first guard, once it moves the arm, is given so long."""

_PROGRAM_S = 3.0
"""A living program, told by the first guard's silence, is given so long to bring the arm to safety."""

_TELL_S = 0.85
"""An arm that is not known to be safe so long after the first guard was heard last is the person's to lift."""


def main() -> int:
    """Run the second guard; 0 after an orderly end or a successful retreat, 1 where the arm could not be moved."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    ask_for_priority()
    orders = json.loads(first_line(_STDIN))
    ear = Ear()
    ear.listen(_STDIN, "guard")
    if orders["ear_fd"] is not None:
        ear.listen(orders["ear_fd"], "program")
    return _Second(orders, ear).until_the_end()


class _Second:
    def __init__(self, orders: dict[str, Any], ear: Ear) -> None:
        self._orders = orders
        self._ear = ear
        self._words_of_program = "guard" if orders["ear_fd"] is None else "program"
        self._away: list[float] | None = None
        self._heard_s = dict.fromkeys(("guard", "program"), time.monotonic())
        self._timeout_s: float = orders["rig"]["guard"]["heartbeat_timeout_s"]
        self._patience_s = max(2 * self._timeout_s, 1.0)
        self._gone = self._ended = self._told = False

    def until_the_end(self) -> int:
        """Watch the first guard until its end; the exit code."""
        first, program = os.getppid(), int(self._orders["program"])
        looked_s = time.monotonic()
        failed_s: float | None = None
        while True:
            for whose, word in self._ear.heard(_LOOK_S):
                self._take(whose, word)
            if self._ended:
                return 0
            now_s = time.monotonic()
            if now_s - looked_s > self._timeout_s / 2:
                # this process stood still itself
                self._heard_s = {who: max(heard_s, now_s) for who, heard_s in self._heard_s.items()}
            looked_s = now_s
            self._tell(now_s)
            if not self._gone and now_s - self._heard_s["guard"] <= self._patience_s:
                failed_s = None
                continue
            failed_s = now_s if failed_s is None else failed_s
            program_dead = not runs(program)
            if self._away is None:
                if program_dead or self._gone:
                    return 0
            elif program_dead or self._program_silent(now_s) or now_s - failed_s > _PROGRAM_S:
                return self._take_over(first, None if program_dead else program)

    def _program_silent(self, now_s: float) -> bool:
        """Whether the program, which runs, does nothing any more; by its own words only."""
        return self._words_of_program == "program" and now_s - self._heard_s["program"] > self._timeout_s

    def _take(self, whose: str, word: str | None) -> None:
        if word is None:
            self._gone = self._gone or whose == "guard"
            return
        now_s = time.monotonic()
        self._heard_s[whose] = max(self._heard_s[whose], now_s)
        kind, *values = word.split()
        if kind == "end":
            self._ended = True
        elif kind == "moving":
            self._heard_s["guard"] = now_s + _MOVING_S
        elif kind == "moved":
            self._heard_s["guard"], self._away = now_s, None
        elif whose != self._words_of_program:
            return  # what the first guard passes on of it may come late
        elif kind == "away":
            self._away = [float(value) for value in values]
        elif kind == "safe":
            self._away = None

    def _tell(self, now_s: float) -> None:
        """Tell the person, once, where the arm may stay where it is; and that it is clear, or guarded, again."""
        silent = self._gone or now_s - self._heard_s["guard"] > _TELL_S
        late = now_s - self._heard_s["guard"] > _TELL_S
        fd = self._orders["tell_fd"]
        if self._away is not None and late and not self._told:
            self._told = True
            does = "is gone" if self._gone else "does not answer"
            tell_person(
                fd, f"the guard {does} with the arm in use: LIFT IT BY HAND unless this says it is clear"
            )
        elif self._told and (self._away is None or not silent):
            self._told = False
            tell_person(fd, "the arm is clear" if self._away is None else "the guard answers again")

    def _take_over(self, first: int, program: int | None) -> int:
        tell_fd = self._orders["tell_fd"]
        if not self._told:
            tell_person(
                tell_fd, "the guard is gone with the arm in use: LIFT IT BY HAND unless this says it is clear"
            )
        if not self._gone:
            # it has not moved the arm, and would hold the card
            with contextlib.suppress(ProcessLookupError):
                os.kill(first, signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL)
        from rig.hardware.retreat import Bearings
        from rig.hardware.taking_over import card_of, move, to_safety_with

        assert self._away is not None
        with card_of(self._orders) as card:
            return move(
                "the guard is gone",
                to_safety_with(card, self._orders),
                Bearings(*self._away),
                program=program,
                tell_fd=tell_fd,
                sentinel_fd=self._orders["sentinel_fd"],
                told=True,
            )


if __name__ == "__main__":
    sys.exit(main())
