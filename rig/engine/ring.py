"""Live samples in shared memory: a ring that one process writes and any other reads, without locks."""

from __future__ import annotations

import struct
import sys
from dataclasses import dataclass
from multiprocessing import resource_tracker, shared_memory
from typing import Self

import numpy as np

from analysis.recordings.trial import Calibration, FloatArray

LAYOUT_VERSION = 2
_MAGIC = b"INDENTER"
_CHANNELS = 3
_CONSTANTS = (
    "volts_per_mm",
    "position_zero_v",
    "volts_per_mn",
    "force_zero_v",
    "command_volts_per_mm",
    "command_zero_v",
)
_FIXED = struct.Struct("<8sIIQd6d")
"""Magic, layout version, channels, capacity in samples, sample rate in Hz, the calibration's constants."""
_COUNT_AT = 96
"""Byte of the counts: samples written since the start, samples announced as being overwritten, marks set."""
_MARKS_AT = 128
_MARKS = 512
_MARK = np.dtype([("index", "<i8"), ("time_s", "<f8"), ("number", "<i8"), ("name", "S16")])
"""A place among the samples where something began: sample since the start, epoch, how many of its kind, name."""

_DATA_AT = _MARKS_AT + _MARKS * _MARK.itemsize

MarkArray = np.ndarray[tuple[int], np.dtype[np.void]]


_TRIES = 3

TRIAL, END, IDLE = "trial", "end", "idle"
"""Marks of a trial's first sample, of the one after its last, and of the first that is shown and not recorded;
others are named as phases are."""


@dataclass(frozen=True, slots=True)
class Mark:
    """Where something began: the sample since the run's start, and the time of the clock on the wall, s."""

    name: str
    index: int
    time_s: float
    number: int


class SampleRing:
    """The writer's end: `capacity` samples of position, force and command, V.

    The count of samples is raised after they stand in place; before a place is overwritten it is announced,
    so that a reader knows which of the samples it copied were whole.
    """

    def __init__(self, capacity: int, sample_rate_hz: float, calibration: Calibration) -> None:
        size = _DATA_AT + 8 * _CHANNELS * capacity
        self._memory = shared_memory.SharedMemory(create=True, size=size)
        constants = [getattr(calibration, name) for name in _CONSTANTS]
        head = (_MAGIC, LAYOUT_VERSION, _CHANNELS, capacity, sample_rate_hz, *constants)
        _FIXED.pack_into(_buffer(self._memory), 0, *head)
        self._capacity = capacity
        self._counts, self._marks, self._samples = _views(self._memory, capacity)
        self._counts[:] = 0

    @property
    def name(self) -> str:
        """The name under which another process opens it."""
        return self._memory.name

    def write(self, position_v: FloatArray, force_v: FloatArray, command_v: FloatArray) -> None:
        """Add samples, (n,) each, V; of more than the ring holds only the last stay."""
        written = int(self._counts[0])
        n = len(position_v)
        self._counts[1] = written + n
        kept = min(n, self._capacity)
        at = (written + n - kept) % self._capacity
        first = min(kept, self._capacity - at)
        for channel, values in enumerate((position_v, force_v, command_v)):
            self._samples[channel, at : at + first] = values[n - kept : n - kept + first]
            self._samples[channel, : kept - first] = values[n - kept + first :]
        self._counts[0] = written + n

    @property
    def written(self) -> int:
        """Samples written since the start."""
        return int(self._counts[0])

    def mark(self, name: str, index: int, time_s: float, number: int = 0) -> None:
        """Say that something of this name (16 bytes of it) began at a sample, written by now or not."""
        n = int(self._counts[2])
        self._marks[n % _MARKS] = (index, time_s, number, name.encode()[:16])
        self._counts[2] = n + 1

    def close(self) -> None:
        """Take the ring away; a reader that has it open keeps its last samples."""
        del self._counts, self._marks, self._samples
        self._memory.close()
        self._memory.unlink()


class RingReader:
    """A reader's end.

    Raises FileNotFoundError where no such ring is, ValueError where it has another layout.
    """

    def __init__(self, name: str) -> None:
        self._memory = _attach(name)
        magic, layout, channels, capacity, rate, *constants = _FIXED.unpack_from(_buffer(self._memory), 0)
        if magic != _MAGIC or layout != LAYOUT_VERSION or channels != _CHANNELS:
            self._memory.close()
            raise ValueError(f"live samples {name}: layout {layout}, this program reads {LAYOUT_VERSION}")
        self.capacity: int = capacity
        self.sample_rate_hz: float = rate
        self.calibration = Calibration(**dict(zip(_CONSTANTS, constants, strict=True)))
        self._counts, self._marks, self._samples = _views(self._memory, capacity)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def written(self) -> int:
        """Samples written since the run began."""
        return int(self._counts[0])

    def latest(self, n: int) -> tuple[int, FloatArray]:
        """Return the last samples, at most n: the index of the first since the run began, and (3, m) in V.

        Only whole samples are returned, also while the writer goes on.
        """
        stop = self.written
        return self._copy(max(0, stop - n), stop)

    def since(self, index: int) -> tuple[int, FloatArray]:
        """Return what came from sample `index` on, as `latest` does.

        A first index above the one asked for says that the ring has gone over what lies between.
        """
        return self._copy(min(index, self.written), self.written)

    def marks(self) -> list[Mark]:
        """Return the last marks in the order they were set, at most 256 of them."""
        for _ in range(_TRIES):
            n = int(self._counts[2])
            first = max(0, n - _MARKS // 2)
            copied = self._marks[np.arange(first, n) % _MARKS]
            if int(self._counts[2]) - first < _MARKS:
                return [
                    Mark(name.decode(errors="replace"), int(index), float(time_s), int(number))
                    for index, time_s, number, name in copied.tolist()
                ]
        return []

    def _copy(self, start: int, stop: int) -> tuple[int, FloatArray]:
        start = max(start, stop - self.capacity)
        n, at = stop - start, start % self.capacity
        first = min(n, self.capacity - at)
        copied = np.empty((_CHANNELS, n))
        copied[:, :first] = self._samples[:, at : at + first]
        copied[:, first:] = self._samples[:, : n - first]
        overwritten = min(n, max(0, int(self._counts[1]) - self.capacity - start))
        return start + overwritten, copied[:, overwritten:]

    def close(self) -> None:
        """Let go of the ring; it stays with its writer."""
        del self._counts, self._marks, self._samples
        self._memory.close()


def _buffer(memory: shared_memory.SharedMemory) -> memoryview:
    assert memory.buf is not None, "the ring is open"
    return memory.buf


def _views(
    memory: shared_memory.SharedMemory, capacity: int
) -> tuple[np.ndarray[tuple[int], np.dtype[np.int64]], MarkArray, FloatArray]:
    counts = np.ndarray((3,), dtype="<i8", buffer=memory.buf, offset=_COUNT_AT)
    marks = np.ndarray((_MARKS,), dtype=_MARK, buffer=memory.buf, offset=_MARKS_AT)
    samples = np.ndarray((_CHANNELS, capacity), dtype="<f8", buffer=memory.buf, offset=_DATA_AT)
    return counts, marks, samples


def _attach(name: str) -> shared_memory.SharedMemory:
    """Open a ring that belongs to another process, without becoming its owner."""
    if sys.version_info >= (3, 13):
        return shared_memory.SharedMemory(name=name, track=False)
    memory = shared_memory.SharedMemory(name=name)
    # before Python 3.13 every opener is taken for the owner, and its exit would take the ring away
    resource_tracker.unregister(memory._name, "shared_memory")  # type: ignore[attr-defined]
    return memory
