"""A thread that fetches the samples from the card, in order, and looks at every one of them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigError
from rig.hardware.daq import CardInput
from rig.hardware.errors import SamplesLateError, SamplesLostError

FloatArray = NDArray[np.float64]

_LATE_S = 5.0
"""How much longer than their duration samples may take before they are called late."""

_POLL_S = 0.01
"""How often the samples at hand are fetched while nobody waits for any."""

_AT_ONCE = 8000
"""Most samples fetched in one call from what is at hand."""

_ALIVE_S = 0.1
"""Who waits for samples says so often that it lives."""

_BEHIND = 2
"""Reads that the card must be ahead of the thread, by the clock, before it is asked what is at hand."""


class Recorder:
    """Fetches samples into a preallocated ring and hands them over without a gap.

    It waits only for samples that the program has asked for, and otherwise fetches what is already at
    hand: so the limits are watched while the program is busy, nothing is lost while there is room in
    the ring and in the driver's buffer, and a card whose time passes only while it is read is never
    driven ahead of the program. Where it has fallen behind the card, it fetches all that is at hand in
    one read: small reads would each cost the same time, and on a busy computer never catch up.

    ``inspect(start, block)`` is called in the thread with every block (n_channels, n), V; what it raises
    (a RigError) is raised in the program's next `take`. ``alive()`` is called in the program's thread
    whenever it waits.
    """

    def __init__(
        self,
        source: CardInput,
        *,
        rate_hz: float,
        ring_samples: int,
        read_samples: int,
        inspect: Callable[[int, FloatArray], None],
        alive: Callable[[], None] = lambda: None,
    ) -> None:
        self._source = source
        self._rate_hz = rate_hz
        self._size = ring_samples
        self._ring: FloatArray = np.zeros((source.n_channels, ring_samples))
        self.read_samples = read_samples
        """Samples fetched at a time while the thread keeps up with the card."""
        self._inspect = inspect
        self._alive = alive
        self._changed = threading.Condition()
        self._filled = 0
        self._taken = 0
        self._wanted = 0
        self._began_s = 0.0
        self._finding: RigError | None = None
        self._dead: RigError | None = None
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)

    @property
    def filled(self) -> int:
        """Samples fetched since the start."""
        return self._filled

    @property
    def taken(self) -> int:
        """Samples handed over since the start."""
        return self._taken

    @property
    def alive(self) -> bool:
        """False once reading has failed."""
        return self._dead is None and not self._stopping

    def acquired(self) -> int:
        """Samples the card has taken since the start, fetched or not."""
        return self._source.acquired()

    def start(self) -> None:
        """Start the card's sampling and the thread."""
        self._source.start()
        self._began_s = time.monotonic()
        self._thread.start()

    def take(self, n: int, timeout_s: float | None = None) -> FloatArray:
        """Hand over the next ``n`` samples, (n_channels, n), waiting for them.

        Raises what `inspect` found, once; what ended the reading; SamplesLateError after
        ``timeout_s`` (default: the samples' duration and 5 s).
        """
        self._alive()
        self.wait_for(self._taken + n, timeout_s)
        block = self.peek(self._taken, self._taken + n)
        with self._changed:
            self._taken += n
            self._changed.notify_all()
        return block

    def peek(self, start: int, stop: int) -> FloatArray:
        """Samples fetched and still in the ring, (n_channels, stop - start), as a copy."""
        block: FloatArray = self._ring[:, np.arange(start, stop) % self._size]
        return block

    def wait_for(self, stop: int, timeout_s: float | None = None, *, heed: bool = True) -> None:
        """Wait until the samples before ``stop`` are fetched; they stay to be taken.

        With ``heed`` off, what `inspect` found waits for the next `take`.
        """
        with self._changed:
            n = stop - self._filled
            if stop - self._taken > self._size:
                raise SamplesLostError(
                    f"{stop - self._taken} samples are to be kept, the ring holds {self._size}; read them in "
                    "smaller parts, and in time"
                )
            self._wanted = max(self._wanted, stop)
            self._changed.notify_all()
            if timeout_s is None:
                timeout_s = max(n, 0) / self._rate_hz + _LATE_S
            deadline_s = time.monotonic() + timeout_s
            while True:
                if heed and self._finding is not None:
                    finding, self._finding = self._finding, None
                    raise finding
                if self._filled >= stop:
                    return
                if self._dead is not None:
                    raise self._dead
                self._alive()
                patience_s = deadline_s - time.monotonic()
                if not self._changed.wait(min(max(patience_s, 0), _ALIVE_S)) and patience_s <= 0:
                    raise SamplesLateError(
                        f"{stop - self._filled} of {n} samples did not come within {timeout_s:.3g} s; "
                        "check the card and its cable, then run again"
                    )

    def stop(self) -> None:
        """End the thread and free the inputs; raises what `inspect` found and no `take` has told."""
        with self._changed:
            self._stopping = True
            self._changed.notify_all()
        if self._thread.ident is not None:
            # a read that hangs ends when its task is cleared
            self._thread.join(_LATE_S)
        self._source.close()
        finding, self._finding = self._finding, None
        if finding is not None:
            raise finding

    def _run(self) -> None:
        try:
            while (n := self._next_size()) is not None:
                if n:
                    self._fetch(n)
        except RigError as error:
            with self._changed:
                self._dead = error
                self._changed.notify_all()

    def _next_size(self) -> int | None:
        """How many samples to fetch now; 0 after an idle while, None at the end."""
        with self._changed:
            # what the program takes wakes the thread as well: only what it asks for ends the wait early
            self._changed.wait_for(lambda: self._wanted > self._filled or self._stopping, _POLL_S)
            if self._stopping:
                return None
            asked = self._wanted - self._filled
            room = self._size - (self._filled - self._taken)
        if asked <= 0:
            return min(self._at_hand(), room, _AT_ONCE)
        n = min(asked, self.read_samples, room)
        due = (time.monotonic() - self._began_s) * self._rate_hz - self._filled
        return n if due < _BEHIND * self.read_samples else max(n, min(self._at_hand(), room, _AT_ONCE))

    def _at_hand(self) -> int:
        """Ask the card; its answer also sets the clock by which the thread knows that it is behind.

        The clocks of card and computer drift apart, and a card's time may pass only while it is read.
        """
        n = self._source.available()
        self._began_s = time.monotonic() - (self._filled + n) / self._rate_hz
        return n

    def _fetch(self, n: int) -> None:
        block = self._source.read(n, n / self._rate_hz + _LATE_S)
        start = self._filled
        at = start % self._size
        first = min(n, self._size - at)
        self._ring[:, at : at + first] = block[:, :first]
        self._ring[:, : n - first] = block[:, first:]
        finding: RigError | None = None
        try:
            self._inspect(start, block)
        except RigError as error:
            finding = error
        with self._changed:
            self._filled += n
            self._finding = self._finding or finding
            self._changed.notify_all()
