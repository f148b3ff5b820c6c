"""Room on the disk, asked for before HDF5 is let near it: the library dies, later, of a disk that refuses it a byte.

A write that fails leaves its caches unflushed; it raises whatever it has at hand, tries again when objects are
given up, and crashes the process at the latest at its end. The system says in plain words that there is no room.
"""

from __future__ import annotations

import os
from pathlib import Path

_AT_ONCE = 1 << 20


def ask_for_room(path: Path, n_bytes: int) -> None:
    """Have a file, new or not, grow by ``n_bytes`` and shrink again. Raises OSError where that can't be.

    What is written next is written within milliseconds of it; who fills a disk just then is not foreseen.
    """
    with path.open("ab", buffering=0) as file:
        size = file.seek(0, os.SEEK_END)
        try:
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), size, n_bytes)
            else:
                for start in range(0, n_bytes, _AT_ONCE):
                    file.write(bytes(min(n_bytes - start, _AT_ONCE)))
        finally:
            file.truncate(size)
