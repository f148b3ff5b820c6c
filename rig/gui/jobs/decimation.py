"""Fewer points that look the same: of every bin the lowest and the highest sample, where they are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]


def extremes(values: NDArray[np.floating], bins: int, start: int = 0, stop: int | None = None) -> IntArray:
    """Return the indices, rising, of the lowest and highest of ``values`` (N,) in each bin; at most 2 ``bins`` + 2.

    Only samples from ``start`` to ``stop`` (exclusive) count. Bins are aligned to the sample index, so that a
    spike stays where it is while the view moves; no spike of a single sample is ever lost.
    """
    stop = len(values) if stop is None else min(stop, len(values))
    start = max(start, 0)
    if stop - start <= 2 * bins:
        return np.arange(start, max(start, stop), dtype=np.int64)
    width = -(-(stop - start) // max(1, bins))
    first = -(-start // width) * width
    whole = first + (stop - first) // width * width
    table = values[first:whole].reshape(-1, width)
    offsets = np.arange(first, whole, width, dtype=np.int64)
    pairs = np.stack([offsets + table.argmin(axis=1), offsets + table.argmax(axis=1)], axis=1)
    ends = [_extremes_of(values, a, b) for a, b in ((start, first), (whole, stop))]
    return np.unique(np.concatenate([ends[0], pairs.ravel(), ends[1]]))


def _extremes_of(values: NDArray[np.floating], start: int, stop: int) -> IntArray:
    """Return where the lowest and the highest of one stretch are, which may be empty."""
    part = values[start:stop]
    found = [start + int(part.argmin()), start + int(part.argmax())] if len(part) else []
    return np.array(found, dtype=np.int64)
