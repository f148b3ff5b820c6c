"""What would hold the window up is done in processes of its own: files, fits, figures, diagnoses."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QObject, QTimer, Signal
from shiboken6 import isValid

from rig.gui.jobs.warming import warm_up
from rig.gui.lane import Job, Lane

_POLL_MS = 20


class Worker(QObject):
    """Does jobs elsewhere and calls back in the event loop, which it never holds up.

    One process is kept warm for what takes up to a second or so; what takes minutes (``long``) has another
    process, started for it, so that a fit never waits for a diagnosis. Both are spawned, at low priority,
    and are started again when they die; `said` tells of that, and of failures nobody else is told of.
    """

    said = Signal(str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._numbers = itertools.count(1)
        self._quick = Lane("worker", self.said.emit, warm_up)
        self._long = Lane("diagnosis", self.said.emit)
        self._timer = QTimer(self)
        self._timer.setInterval(_POLL_MS)
        self._timer.timeout.connect(self._look)
        self._quick.start()
        self._timer.start()

    @property
    def busy(self) -> bool:
        """Whether anything is under way or waits."""
        return self._quick.busy or self._long.busy

    @property
    def pids(self) -> tuple[int, ...]:
        """The ids of the processes there are."""
        return tuple(lane.pid for lane in (self._quick, self._long) if lane.pid is not None)

    def ask(
        self,
        what: str,
        function: Callable[..., Any],
        *arguments: Any,
        then: Callable[[Any], None],
        failed: Callable[[str], None] | None = None,
        key: str = "",
        urgent: bool = False,
        long: bool = False,
    ) -> int:
        """Have ``function(*arguments)`` done and its result given to ``then``; return the job's number.

        Function and arguments must be picklable; ``what`` says in words what is done. ``failed`` is given one
        line where there is no result. An earlier job of the same ``key`` is forgotten: its answer is stale.
        """
        if key:
            self.forget(key)
        number = next(self._numbers)
        lane = self._long if long else self._quick
        lane.put(Job(number, key, what, function, arguments, then, failed or self.said.emit), urgent=urgent)
        return number

    def forget(self, key: str) -> None:
        """Drop the jobs of a key: nobody is called back for them."""
        for lane in (self._quick, self._long):
            lane.drop(key)

    def stop(self, key: str) -> None:
        """End the jobs of a key at once; nobody is called back for them."""
        self.forget(key)
        self._long.stop(key)

    def close(self) -> None:
        """End the processes. Without it they end when the window does."""
        self._timer.stop()
        for lane in (self._quick, self._long):
            lane.close()

    def _look(self) -> None:
        for lane in (self._quick, self._long):
            for outcome in lane.outcomes():
                if not _asker_stands(outcome.job.then):
                    continue
                if outcome.problem:
                    outcome.job.failed(outcome.problem)
                else:
                    outcome.job.then(outcome.result)


def _asker_stands(then: Callable[[Any], object]) -> bool:
    """Whether who is to be called back is still there: a page may go while its job runs."""
    function = getattr(then, "func", then)
    closure = getattr(function, "__closure__", None) or ()
    held = [getattr(function, "__self__", None), *(cell.cell_contents for cell in closure)]
    return all(isValid(each) for each in held if isinstance(each, QObject))
