"""The bytes of a running trial: datasets of a file whose structure stands, written at known offsets."""

from __future__ import annotations

import errno
import os
import threading
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.live.locking import lock


class RunningFile:
    """One file, locked for as long as it is open; several threads may write and read it.

    `offsets` says where the bytes of each dataset begin.
    """

    def __init__(self, path: Path, offsets: dict[str, int]) -> None:
        self._path = path
        self._offsets = offsets
        self._turn = threading.Lock()
        self._file: FileIO = path.open("rb+", buffering=0)
        lock(self._file)
        self._size = os.fstat(self._file.fileno()).st_size

    def write(self, dataset: str, values: NDArray[Any], first: int = 0) -> None:
        """Write rows of a dataset, the first of them row `first`; they are the system's when it returns."""
        view = values.view(np.uint8).data
        with self._turn:
            if os.fstat(self._file.fileno()).st_size < self._size:
                raise OSError(errno.EIO, "another program has cut the file while it was written")
            self._file.seek(self._offsets[dataset] + values.itemsize * first, os.SEEK_SET)
            while view:
                view = view[self._file.write(view) :]

    def read(self, dataset: str, start: int, stop: int) -> NDArray[np.float64]:
        """Return samples `start` to `stop` (exclusive) of a signal. Raises OSError where they are missing."""
        values = np.empty(stop - start, dtype="<f8")
        view = values.data.cast("B")
        filled = 0
        with self._turn:
            self._file.seek(self._offsets[dataset] + 8 * start, os.SEEK_SET)
            while filled < len(view):
                got = self._file.readinto(view[filled:])
                if not got:
                    raise OSError(f"{self._path}: was cut short by another program while it was written")
                filled += got
        return values

    def close(self) -> None:
        """Close the file and let go of its lock."""
        self._file.close()
