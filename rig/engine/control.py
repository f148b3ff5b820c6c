"""What is asked of a run while it runs: taken on or refused at once by any thread, done by the run's own."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Collection

from rig.engine.interrupts import Interrupts
from rig.engine.prompts import Desk
from rig.engine.requests import (
    Answer,
    Discard,
    GoOn,
    Pause,
    Repeat,
    Request,
    Restore,
    Retreat,
    Skip,
    Stop,
    Verdict,
)
from rig.engine.states import ENDED, State

_PREPARING = frozenset({State.PREPARING, State.RESTING, State.PAUSED})
_RECORDING = frozenset(
    {
        State.POSITIONING,
        State.APPROACHING,
        State.DWELLING,
        State.RAMPING,
        State.HOLDING,
        State.RETRACTING,
        State.CLEARING,
        State.SWEEPING,
    }
)
RETREATED = "ended by the operator: retreat"


class Skipped(Exception):  # noqa: N818 - what happens to a trial, no error of the program
    """The operator leaves this trial out."""


class Control:
    """Holds what was asked of one run until its thread comes to it.

    `hear` never waits and never raises; the runner calls the rest.
    """

    def __init__(self, interrupts: Interrupts, desk: Desk | None = None) -> None:
        self.interrupts = interrupts
        self.desk = desk
        self._lock = threading.Lock()
        self._state = State.IDLE
        self._errands: deque[Discard | Restore] = deque()
        self._repeats: deque[str] = deque()
        self._pausing = False
        self._skip_rest = False
        self._skip_trial = False
        self._known: Collection[str] = {}
        self._began = False

    def pausing(self) -> bool:
        """Whether the run is to pause, or pauses."""
        return self._pausing

    def begin(self, known: Collection[str]) -> None:
        """The run begins; `known` are the names of the trials of its plan."""
        self._known = known
        self._began = True

    def entered(self, state: State) -> None:
        """The run has gone to this state."""
        with self._lock:
            self._state = state
            if state is not State.RESTING:
                self._skip_rest = False

    def hear(self, request: Request) -> Verdict:
        """Take a request on, or refuse it."""
        with self._lock:
            why = self._take(request)
        return Verdict(request.id, accepted=not why, why=why)

    def take_errands(self) -> list[Discard | Restore]:
        """Return what is to be done to files, once."""
        with self._lock:
            errands = list(self._errands)
            self._errands.clear()
        return errands

    def take_repeats(self) -> list[str]:
        """Return the names of the trials to be recorded again, once."""
        with self._lock:
            repeats = list(self._repeats)
            self._repeats.clear()
        return repeats

    def check(self) -> None:
        """Raise what was asked for while the run waits: Interrupted, or Skipped."""
        self.interrupts.check()
        with self._lock:
            skipped, self._skip_trial = self._skip_trial, False
        if skipped:
            raise Skipped("left out by the operator")

    @property
    def rest_skipped(self) -> bool:
        """Whether the rest under way is to end now."""
        return self._skip_rest

    def _take(self, request: Request) -> str:  # noqa: PLR0911, PLR0912 - a table: a request, its answer
        if not self._began or self._state in ENDED:
            return "no run is in progress"
        match request:
            case Stop():
                self.interrupts.request()
                return ""
            case Retreat():
                if self._state not in _RECORDING:
                    return f"the arm is clear of the skin already ({self._state})"
                self._pausing = True  # someone is to look before it goes on
                self.interrupts.request_cut(RETREATED)
                return ""
            case Pause():
                self._pausing = True
                return ""
            case GoOn():
                why = "" if self._pausing else "the run does not pause"
                self._pausing = False
                return why
            case Skip(what=what):
                return self._skip(what)
            case Repeat(trial=trial):
                if trial not in self._known:
                    return f"no trial {trial} in this plan"
                self._repeats.append(trial)
                return ""
            case Discard() | Restore():
                if "/" in request.file or "\\" in request.file or not request.file.endswith(".h5"):
                    return f"{request.file}: is no file of this run"
                self._errands.append(request)
                return ""
            case Answer(prompt=prompt, answer=answer, value=value):
                if self.desk is None:
                    return "this run asks nobody"
                return self.desk.answer(prompt, value) if answer == "done" else self.desk.cancel(prompt)
            case _:
                return "a run is in progress: stop it first, or let it end"

    def _skip(self, what: str) -> str:
        if what == "rest":
            if self._state is not State.RESTING:
                return "the finger does not rest"
            self._skip_rest = True
        else:
            if self._state not in _PREPARING:
                return "the trial is being recorded: retreat ends it"
            self._skip_trial = True
        return ""
