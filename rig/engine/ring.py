"""Live samples in shared memory: a ring that one process writes and any other reads, without locks."""

from __future__ import annotations

import struct
import sys
from multiprocessing import resource_tracker, shared_memory
from typing import Self

import numpy as np

from analysis.recordings.trial import Calibration, FloatArray

LAYOUT_VERSION = 1
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
"""Byte of the write count: samples written since the start, then samples announced as being overwritten."""
_DATA_AT = 128


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
        self._counts, self._samples = _views(self._memory, capacity)
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
        places = np.arange(written + max(0, n - self._capacity), written + n) % self._capacity
        for channel, values in enumerate((position_v, force_v, command_v)):
            self._samples[channel, places] = values[-self._capacity :]
        self._counts[0] = written + n

    def close(self) -> None:
        """Take the ring away; a reader that has it open keeps its last samples."""
        del self._counts, self._samples
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
        self._counts, self._samples = _views(self._memory, capacity)

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
        start = max(0, stop - min(n, self.capacity))
        copied = self._samples[:, np.arange(start, stop) % self.capacity]
        overwritten = max(0, int(self._counts[1]) - self.capacity - start)
        return start + overwritten, copied[:, overwritten:]

    def close(self) -> None:
        """Let go of the ring; it stays with its writer."""
        del self._counts, self._samples
        self._memory.close()


def _buffer(memory: shared_memory.SharedMemory) -> memoryview:
    assert memory.buf is not None, "the ring is open"
    return memory.buf


def _views(
    memory: shared_memory.SharedMemory, capacity: int
) -> tuple[np.ndarray[tuple[int], np.dtype[np.int64]], FloatArray]:
    counts = np.ndarray((2,), dtype="<i8", buffer=memory.buf, offset=_COUNT_AT)
    samples = np.ndarray((_CHANNELS, capacity), dtype="<f8", buffer=memory.buf, offset=_DATA_AT)
    return counts, samples


def _attach(name: str) -> shared_memory.SharedMemory:
    """Open a ring that belongs to another process, without becoming its owner."""
    if sys.version_info >= (3, 13):
        return shared_memory.SharedMemory(name=name, track=False)
    memory = shared_memory.SharedMemory(name=name)
    # before Python 3.13 every opener is taken for the owner, and its exit would take the ring away
    resource_tracker.unregister(memory._name, "shared_memory")  # type: ignore[attr-defined]
    return memory
