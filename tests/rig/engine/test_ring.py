"""Live samples in shared memory: whole samples only, whoever reads and however late."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from itertools import count

import numpy as np
import pytest

from analysis.recordings.trial import Calibration
from rig.engine.ring import RingReader, SampleRing

CALIBRATION = Calibration(2.0, -10.0, 0.015, 0.1, 2.1, -9.9)


@pytest.fixture
def ring() -> Iterator[SampleRing]:
    made = SampleRing(1000, 8000.0, CALIBRATION)
    yield made
    made.close()


def numbered(start: int, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    values = np.arange(start, start + n, dtype=float)
    return values, -values, 2 * values


def test_a_reader_sees_what_was_written_and_how_to_read_it(ring: SampleRing) -> None:
    ring.write(*numbered(0, 300))
    with RingReader(ring.name) as reader:
        assert reader.calibration == CALIBRATION
        assert reader.sample_rate_hz == 8000.0
        start, volts = reader.latest(100)
        assert start == 200
        np.testing.assert_array_equal(volts, np.array(numbered(200, 100)))


def test_the_ring_keeps_the_last_samples(ring: SampleRing) -> None:
    for start in range(0, 5000, 250):
        ring.write(*numbered(start, 250))
    with RingReader(ring.name) as reader:
        start, volts = reader.latest(10**6)
        assert start == 4000
        np.testing.assert_array_equal(volts, np.array(numbered(4000, 1000)))


def test_more_than_the_ring_holds_in_one_go(ring: SampleRing) -> None:
    ring.write(*numbered(0, 2500))
    with RingReader(ring.name) as reader:
        assert reader.written == 2500
        np.testing.assert_array_equal(reader.latest(1000)[1], np.array(numbered(1500, 1000)))


def test_a_reader_never_sees_torn_samples(ring: SampleRing) -> None:
    stop = threading.Event()

    def write() -> None:
        for i in count():
            if stop.is_set():
                return
            ring.write(*numbered(40 * i, 40))

    writer = threading.Thread(target=write)
    writer.start()
    deadline = time.monotonic() + 1.0
    looked = 0
    with RingReader(ring.name) as reader:
        while time.monotonic() < deadline:
            start, volts = reader.latest(1000)
            np.testing.assert_array_equal(volts, np.array(numbered(start, volts.shape[1])))
            looked += volts.shape[1]
    stop.set()
    writer.join()
    assert looked > 0


def test_another_process_reads_it_and_leaves_it(ring: SampleRing) -> None:
    ring.write(*numbered(0, 10))
    code = (
        "import sys; from rig.engine.ring import RingReader; reader = RingReader(sys.argv[1]); "
        "print(reader.latest(5)[1][0].tolist()); reader.close()"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, ring.name], capture_output=True, text=True, check=False
    )
    assert done.stderr == ""
    assert done.stdout.strip() == "[5.0, 6.0, 7.0, 8.0, 9.0]"
    with RingReader(ring.name) as reader:
        assert reader.written == 10


def test_another_layout_is_refused(ring: SampleRing) -> None:
    ring._memory.buf[8] = 99
    with pytest.raises(ValueError, match="layout 99"):
        RingReader(ring.name)


def test_no_such_ring() -> None:
    with pytest.raises(FileNotFoundError):
        RingReader("indenter-no-such-ring")
