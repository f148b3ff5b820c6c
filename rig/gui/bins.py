"""The live signals in little room: lowest and highest of every 64 samples, over the whole trial and beyond."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]

BIN = 64
"""Samples in a bin. Bins are counted from the first sample of the bench, so that one never moves."""

_CHANNELS = 2


@dataclass(frozen=True, slots=True)
class Trace:
    """What is drawn of one signal: (2 m,) sample indices and values, the lowest and the highest of each bin."""

    index: Float64
    values: Float64


class Bins:
    """Position and force, V, of the last `seconds`; older bins are overwritten. A gap holds NaN."""

    def __init__(self, sample_rate_hz: float, seconds: float = 3600.0) -> None:
        self._n = int(seconds * sample_rate_hz / BIN) + 1
        self._low: Float32 = np.full((_CHANNELS, self._n), np.nan, dtype=np.float32)
        self._high: Float32 = np.full((_CHANNELS, self._n), np.nan, dtype=np.float32)
        self._first: int | None = None
        self._rest: Float64 = np.empty((_CHANNELS, 0))
        self.next_sample = 0
        """The sample that is expected next."""
        self.n_missed = 0
        """Samples that went by unseen; the recording has them all the same."""

    @property
    def first_sample(self) -> int:
        """The oldest sample that is still told of."""
        last = self.next_sample // BIN
        return BIN * max(self._first or 0, last - self._n + 1)

    def add(self, start: int, volts: Float64) -> None:
        """Add samples (2 or more channels, n), V, the first of which is sample `start` of the bench."""
        volts = volts[:_CHANNELS]
        if start < self.next_sample:
            volts = volts[:, self.next_sample - start :]
            start = self.next_sample
        if not volts.shape[1]:
            return
        if self._first is None:
            self._first, self.next_sample = start // BIN, start
        if start > self.next_sample:
            self._gap(start)
        # the bin under way is worked out anew with what has come for it
        begin = self.next_sample - self._rest.shape[1]
        whole = np.concatenate([self._rest, volts], axis=1)
        self.next_sample = start + volts.shape[1]
        lead = begin % BIN
        if lead:
            n = min(BIN - lead, whole.shape[1])
            self._put(begin // BIN, whole[:, :n, None].transpose(0, 2, 1), join=True)
            whole, begin = whole[:, n:], begin + n
        n_whole = whole.shape[1] // BIN
        if n_whole:
            self._put(begin // BIN, whole[:, : n_whole * BIN].reshape(_CHANNELS, n_whole, BIN))
        self._rest = whole[:, n_whole * BIN :].copy()
        if self._rest.shape[1]:
            self._put(begin // BIN + n_whole, self._rest[:, None, :])

    def trace(self, channel: int, start: int, stop: int, most: int) -> Trace:
        """Return the samples `start` to `stop` in at most `most` bins, merged by whole multiples of a bin.

        Merged bins begin at multiples of their width, counted from the bench's first sample: while the view
        rolls, no bin changes what it holds, and no spike changes its height or its place.
        """
        first = max(start, self.first_sample) // BIN
        last = -(-min(stop, self.next_sample) // BIN)
        if last <= first:
            return Trace(np.empty(0), np.empty(0))
        merge = max(1, -(-(last - first) // max(most, 1)))
        first -= first % merge
        first = max(first, -(-self.first_sample // BIN))
        places = np.arange(first, last) % self._n
        low, high = self._low[channel, places], self._high[channel, places]
        if merge > 1:
            edges = np.arange(first - first % merge, last, merge) - first
            edges = np.maximum(edges, 0)
            low, high = np.fmin.reduceat(low, edges), np.fmax.reduceat(high, edges)
            index = BIN * (first + edges).astype(np.float64)
        else:
            index = BIN * np.arange(first, last, dtype=np.float64)
        return interleaved(index, low, high)

    def _gap(self, start: int) -> None:
        self.n_missed += start - self.next_sample
        missed = np.arange(
            -(-self.next_sample // BIN), min(start // BIN + 1, self.next_sample // BIN + self._n)
        )
        self._low[:, missed % self._n] = np.nan
        self._high[:, missed % self._n] = np.nan
        self._rest = np.empty((_CHANNELS, 0))
        self.next_sample = start

    def _put(self, first: int, parts: Float64, *, join: bool = False) -> None:
        places = np.arange(first, first + parts.shape[1]) % self._n
        low, high = parts.min(axis=2), parts.max(axis=2)
        if join:
            low = np.fmin(low, self._low[:, places])
            high = np.fmax(high, self._high[:, places])
        self._low[:, places], self._high[:, places] = low, high


def fine_trace(start: int, values: Float64, most: int) -> Trace:
    """Return single samples, (n,), the first of which is sample `start`, in at most `most` bins, as `Bins` does."""
    n = len(values)
    merge = max(1, -(-n // max(most, 1)))
    if merge == 1:
        return Trace(np.arange(start, start + n, dtype=np.float64), values)
    edges = np.maximum(np.arange(start - start % merge, start + n, merge) - start, 0)
    low, high = np.minimum.reduceat(values, edges), np.maximum.reduceat(values, edges)
    return interleaved((start + edges).astype(np.float64), low, high)


def interleaved(index: Float64, low: Float32 | Float64, high: Float32 | Float64) -> Trace:
    """Return the trace that goes from the low to the high of each bin."""
    values = np.empty(2 * len(index))
    values[0::2], values[1::2] = low, high
    return Trace(np.repeat(index, 2), values)
