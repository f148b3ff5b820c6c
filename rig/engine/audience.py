"""Those who look on: each in a thread of its own, so that none of them can hold a run up or make it fail."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Protocol, Self

from rig.engine.progress import Snapshot
from rig.hardware.lever import Chunk

_log = logging.getLogger(__name__)

PATIENCE_S = 0.05
"""An observer that is in step is waited for so long, then no more until it has caught up."""

_KEPT = 4096
"""What an observer that is behind may leave unread; then the oldest is dropped."""


class Observer(Protocol):
    """Sees a run: the feed, a progress bar, a test."""

    def show(self, snapshot: Snapshot) -> None:
        """See what the run does now."""
        ...

    def follow(self, chunk: Chunk) -> None:
        """See samples as they come."""
        ...

    def mark(self, name: str, sample: int, chunk_start: int) -> None:
        """Hear that a phase, or a trial, began at a sample of the trial; `chunk_start` is where it is by now."""
        ...


class Audience:
    """Tells observers, in order, as a context manager.

    Of a snapshot the run waits for an observer that keeps up, so that what it does at a state is done in that
    state; one that blocks costs `patience_s` once. Samples are never waited for, nor is anyone on the way
    off the skin. What an observer raises is logged, once each kind.
    """

    def __init__(self, observers: Sequence[Observer], patience_s: float = PATIENCE_S) -> None:
        self._seats = [_Seat(observer) for observer in observers]
        self._patience_s = patience_s

    def __enter__(self) -> Self:
        for seat in self._seats:
            seat.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for seat in self._seats:
            seat.end(self._patience_s)

    def show(self, snapshot: Snapshot, *, wait: bool = True) -> None:
        """Show a snapshot to everyone."""
        self._tell(lambda observer: observer.show(snapshot), wait=wait)

    def follow(self, chunk: Chunk) -> None:
        """Show samples to everyone."""
        self._tell(lambda observer: observer.follow(chunk))

    def mark(self, name: str, sample: int, now: int) -> None:
        """Tell everyone what began at a sample of the trial, which is at sample `now`."""
        self._tell(lambda observer: observer.mark(name, sample, now))

    def _tell(self, what: Callable[[Observer], None], *, wait: bool = False) -> None:
        for seat in self._seats:
            seat.tell(what, self._patience_s if wait else 0.0)


class _Seat:
    """One observer, its thread, and what it has not heard yet."""

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self._waiting: deque[Callable[[Observer], None]] = deque(maxlen=_KEPT)
        self._changed = threading.Condition()
        self._busy = False
        self._behind = False
        self._ended = False
        self._said: set[str] = set()
        self._thread = threading.Thread(target=self._listen, name="observer", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def tell(self, what: Callable[[Observer], None], patience_s: float) -> None:
        with self._changed:
            self._waiting.append(what)
            self._changed.notify_all()
            if patience_s and not self._behind:
                self._behind = not self._changed.wait_for(self._idle, patience_s)

    def end(self, patience_s: float) -> None:
        with self._changed:
            self._ended = True
            self._changed.notify_all()
        # one that hangs stays behind: its thread ends with the program
        self._thread.join(1.0 if not self._behind else patience_s)

    def _idle(self) -> bool:
        return not self._waiting and not self._busy

    def _listen(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                if not self._waiting:
                    self._behind = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._waiting or self._ended)
                if not self._waiting:
                    return
                what = self._waiting.popleft()
                self._busy = True
            try:
                what(self._observer)
            except Exception as error:  # noqa: BLE001 - whatever it is, the run goes on
                if repr(error) not in self._said:
                    self._said.add(repr(error))
                    _log.exception("one who looks on failed, and the run goes on")
