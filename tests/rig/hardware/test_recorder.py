"""The reader thread: in order, without a gap, never ahead of the program, never silent about failure."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any, cast

import numpy as np
import pytest

from rig.errors import RigError
from rig.hardware.errors import CardError, SamplesLateError, SamplesLostError
from rig.hardware.recorder import Recorder

RATE_HZ = 8000.0


class VirtualSource:
    """A card whose time passes only while it is read: sample i has the value i on every channel."""

    n_channels = 3

    def __init__(self) -> None:
        self.position = 0
        self.closed = False
        self.largest = 0

    def start(self) -> None:
        pass

    def read(self, n: int, timeout_s: float) -> np.ndarray:
        assert timeout_s > n / RATE_HZ
        block = np.tile(np.arange(self.position, self.position + n, dtype=float), (self.n_channels, 1))
        self.position += n
        self.largest = max(self.largest, n)
        return block

    def available(self) -> int:
        return 0

    def acquired(self) -> int:
        return self.position

    def close(self) -> None:
        self.closed = True


class RealSource(VirtualSource):
    """A card whose samples come whether they are read or not."""

    def __init__(self, *, buffer_samples: int) -> None:
        super().__init__()
        self._buffer = buffer_samples
        self._began_s = time.monotonic()

    def start(self) -> None:
        self._began_s = time.monotonic()

    def acquired(self) -> int:
        return int((time.monotonic() - self._began_s) * RATE_HZ)

    def available(self) -> int:
        return self.acquired() - self.position

    def read(self, n: int, timeout_s: float) -> np.ndarray:
        if self.available() > self._buffer:
            raise SamplesLostError("overwritten", -200279)
        while self.available() < n:
            time.sleep(0.001)
        return super().read(n, timeout_s)


class SlowSource(RealSource):
    """A card that takes 10 ms to answer each read, as on a busy computer, however many samples it is for."""

    def read(self, n: int, timeout_s: float) -> np.ndarray:
        time.sleep(0.01)
        return super().read(n, timeout_s)


class BrokenSource(VirtualSource):
    """A card that fails after some samples."""

    def read(self, n: int, timeout_s: float) -> np.ndarray:
        if self.position >= 400:
            raise CardError("the card is gone", -201003)
        return super().read(n, timeout_s)


@contextmanager
def recording(
    source: VirtualSource, inspect: Any = lambda start, block: None, **options: Any
) -> Iterator[Recorder]:
    options = {"rate_hz": RATE_HZ, "ring_samples": 4000, "read_samples": 80, **options}
    recorder = Recorder(cast(Any, source), inspect=inspect, **options)
    recorder.start()
    try:
        yield recorder
    finally:
        recorder.stop()
    assert source.closed


def test_samples_come_in_order_and_without_a_gap_round_the_ring() -> None:
    rng = np.random.default_rng(0)
    with recording(VirtualSource()) as recorder:
        expected = 0
        for n in rng.integers(1, 900, 60):
            block = recorder.take(int(n))
            assert block.shape == (3, n)
            assert np.array_equal(block[0], np.arange(expected, expected + n))
            expected += int(n)


def test_a_card_that_lives_on_reads_is_never_driven_ahead_of_the_program() -> None:
    source = VirtualSource()
    with recording(source) as recorder:
        recorder.take(100)
        time.sleep(0.15)
        assert source.position == 100
        recorder.wait_for(260)
        time.sleep(0.1)
        assert source.position == 260
        assert recorder.taken == 100
        assert np.array_equal(recorder.take(160)[1], np.arange(100, 260))
    assert source.largest <= 80


def test_nothing_is_lost_while_the_program_is_busy() -> None:
    # a buffer of 0.1 s: only because the thread reads on is nothing lost in 0.45 s
    with recording(RealSource(buffer_samples=800)) as recorder:
        recorder.take(80)
        time.sleep(0.45)
        assert recorder.filled > 2400
        assert np.array_equal(recorder.take(3600)[0], np.arange(80, 3680))


def test_a_thread_that_falls_behind_fetches_all_that_is_at_hand() -> None:
    # reads of 3 ms that take 10 ms each would be 1 s behind after 1.5 s
    source = SlowSource(buffer_samples=80_000)
    with recording(source, read_samples=24) as recorder:
        while recorder.taken < 12_000:
            recorder.take(24)
        assert source.acquired() - recorder.taken < 2000


def test_every_sample_is_inspected_while_the_program_is_busy() -> None:
    seen: list[tuple[int, int]] = []
    with recording(
        RealSource(buffer_samples=8000), lambda start, block: seen.append((start, block.shape[1]))
    ):
        time.sleep(0.2)
    assert sum(n for _, n in seen) > 800
    assert all(start + n == following for (start, n), (following, _) in pairwise(seen))


def test_samples_that_are_lost_for_good_are_told() -> None:
    with recording(RealSource(buffer_samples=800), ring_samples=400) as recorder:
        recorder.take(80)
        time.sleep(0.3)  # the ring is full, so the buffer overflows
        with pytest.raises(SamplesLostError):
            recorder.take(400)
            recorder.take(400)
        assert not recorder.alive


def test_a_failure_of_the_card_reaches_the_program_again_and_again() -> None:
    with recording(BrokenSource()) as recorder:
        assert recorder.take(400)[0][-1] == 399
        for _ in range(2):
            with pytest.raises(CardError, match="gone"):
                recorder.take(80)
        assert not recorder.alive


def test_what_inspection_finds_is_raised_once_and_reading_goes_on() -> None:
    def inspect(start: int, block: np.ndarray) -> None:
        if start <= 160 < start + block.shape[1]:
            raise RigError("a limit")

    with recording(VirtualSource(), inspect) as recorder:
        recorder.take(160)
        with pytest.raises(RigError, match="a limit"):
            recorder.take(160)
        assert np.array_equal(recorder.take(320)[0], np.arange(160, 480))


def test_samples_that_do_not_come_are_called_late() -> None:
    released = threading.Event()

    class Stuck(VirtualSource):
        def read(self, n: int, timeout_s: float) -> np.ndarray:
            released.wait(5.0)
            return super().read(n, timeout_s)

    with recording(Stuck()) as recorder:
        began_s = time.monotonic()
        with pytest.raises(SamplesLateError, match="80 of 80 samples"):
            recorder.take(80, timeout_s=0.1)
        assert time.monotonic() - began_s < 2.0
        released.set()
        assert recorder.take(80).shape == (3, 80)


def test_more_than_the_ring_holds_is_refused() -> None:
    with recording(VirtualSource()) as recorder, pytest.raises(SamplesLostError, match="the ring holds 4000"):
        recorder.take(4001)
