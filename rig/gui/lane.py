"""One worker process and its queue: one job at a time, in order, restarted when it dies."""

from __future__ import annotations

import multiprocessing
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from queue import Empty, SimpleQueue
from typing import Any

from rig.gui.jobs.serving import Answer, serve

NICENESS = 10
_MOST_STARTS = 3
_LEAVE_S = 2.0


@dataclass(frozen=True, slots=True)
class Job:
    """One thing to be done elsewhere: ``what`` says it in words, ``key`` which later job replaces it."""

    number: int
    key: str
    what: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    then: Callable[[Any], None]
    failed: Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a job ended: its result, or in ``problem`` one line that says why there is none."""

    job: Job
    result: Any = None
    problem: str = ""


class Lane:
    """Feeds one spawned process; `outcomes` is polled and never waits.

    ``warm`` is called in the process as soon as it is there; without it the process starts with the first
    job. `said` is told of deaths.
    """

    def __init__(self, name: str, said: Callable[[str], None], warm: Callable[[], Any] | None = None) -> None:
        self._name = name
        self._said = said
        self._warm = warm
        self._queue: deque[Job] = deque()
        self._current: Job | None = None
        self._dropped = False
        self._starts = 0
        self._process: Any = None
        self._connection: Connection[Any, Answer] | None = None
        self._reader: threading.Thread | None = None
        self._heard: SimpleQueue[Answer | None] = SimpleQueue()
        self._warming = False

    @property
    def busy(self) -> bool:
        """Whether something is under way or waits."""
        return self._current is not None or bool(self._queue) or self._warming

    @property
    def pid(self) -> int | None:
        """The process's id, None where there is none."""
        return None if self._process is None else self._process.pid

    def start(self) -> None:
        """Start the process and warm it up."""
        self._starts += 1
        context = multiprocessing.get_context("spawn")
        here, there = context.Pipe()
        self._heard = SimpleQueue()
        self._connection = here
        self._process = context.Process(target=serve, args=(there, NICENESS), name=self._name)
        self._process.start()
        there.close()
        self._reader = threading.Thread(
            target=_listen, args=(here, self._heard), name=f"{self._name}-answers", daemon=True
        )
        self._reader.start()
        if self._warm is not None:
            self._warming = True
            here.send((-1, self._warm, ()))

    def put(self, job: Job, *, urgent: bool = False) -> None:
        """Queue a job; an urgent one goes to the front."""
        if urgent:
            self._queue.appendleft(job)
        else:
            self._queue.append(job)
        self._next()

    def drop(self, key: str) -> None:
        """Forget the jobs of a key: those that wait are not done, the answer of the present one is lost."""
        self._queue = deque(job for job in self._queue if job.key != key)
        if self._current is not None and self._current.key == key:
            self._dropped = True

    def stop(self, key: str) -> None:
        """Forget the jobs of a key, and end the process where it works on one."""
        self.drop(key)
        if self._current is not None and self._current.key == key:
            self._process.terminate()

    def outcomes(self) -> list[Outcome]:
        """Return what has ended since the last call, and send what waits."""
        ended: list[Outcome] = []
        with suppress(Empty):
            while self._process is not None:
                answer = self._heard.get_nowait()
                if answer is not None:
                    ended.extend(self._answered(answer))
                elif self._process.exitcode is not None:
                    ended.extend(self._died())
                else:
                    self._heard.put(None)  # it tidies up still: seen again at the next look
                    break
        self._next()
        return ended

    def close(self) -> None:
        """End the process; what it works on is lost, what waits is not done."""
        self._queue.clear()
        self._current = None
        self._warming = False
        if self._process is None:
            return
        self._process.terminate()
        self._process.join(_LEAVE_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._tidy()

    def _answered(self, answer: Answer) -> list[Outcome]:
        self._starts = 0
        number, how, result = answer
        if number < 0:
            self._warming = False
            return []
        job, dropped = self._current, self._dropped
        self._current, self._dropped = None, False
        if job is None or job.number != number or dropped:
            return []
        if how == "done":
            return [Outcome(job, result)]
        return [Outcome(job, problem=result if how == "refused" else f"{job.what} failed: {result}")]

    def _died(self) -> list[Outcome]:
        job, dropped = self._current, self._dropped
        self._current, self._dropped, self._warming = None, False, False
        code = self._process.exitcode
        self._tidy()
        if dropped:
            return []  # ended because it was asked to
        doing = f" during: {job.what}" if job is not None else ""
        words = f"the {self._name} process died (exit code {code}){doing}"
        ended = [Outcome(job, problem=f"{words}; it is started again")] if job is not None else []
        if self._starts >= _MOST_STARTS:
            ended += [Outcome(waiting, problem=f"{words}, and can't be started") for waiting in self._queue]
            self._queue.clear()
            self._said(f"{words} {self._starts} times in a row; restart the window")
        elif self._warm is not None:
            self._said(f"{words}; it is started again")
            self.start()
        return ended

    def _tidy(self) -> None:
        if self._reader is not None:
            self._reader.join()
        if self._connection is not None:
            self._connection.close()
        self._process.close()
        self._process = self._connection = self._reader = None

    def _next(self) -> None:
        if self._current is not None or not self._queue:
            return
        if self._process is None:
            self.start()
        assert self._connection is not None
        job = self._queue[0]
        with suppress(
            OSError
        ):  # it has just died: its reader says so next, and the job waits for the next one
            self._connection.send((job.number, job.function, job.arguments))
            self._queue.popleft()
            self._current = job


def _listen(connection: Connection[Any, Answer], heard: SimpleQueue[Answer | None]) -> None:
    """Take answers from the pipe in a thread of its own: a long one would hold the event loop up."""
    while True:
        try:
            heard.put(connection.recv())
        except (EOFError, OSError):
            heard.put(None)
            return
