"""Whether another process is writing a trial file: an advisory lock that dies with its process.

POSIX record locks, because a forked child does not inherit them: a guard process that outlives a killed
writer does not keep its file locked. On Windows an open file can't be replaced, which protects it as well.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from io import FileIO
from pathlib import Path


def lock(file: FileIO) -> None:
    """Take the lock of a file open for writing, for as long as it is open.

    File systems without locks are no reason not to record: there the lock is left out.
    """
    if sys.platform != "win32":
        with suppress(OSError):
            os.lockf(file.fileno(), os.F_TLOCK, 0)


def is_locked(path: Path) -> bool:
    """Return whether another process holds the lock of a file."""
    if sys.platform == "win32" or not os.access(path, os.W_OK):
        return False
    while True:
        with path.open("rb+", buffering=0) as file:
            try:
                os.lockf(file.fileno(), os.F_TEST, 0)
            except (BlockingIOError, PermissionError):
                return True
            except OSError:
                return False  # a file system without locks
            # a writer whose file outgrows its room lets go of the old one once the new one stands in its place
            if _stands_at(path, file):
                return False


def _stands_at(path: Path, file: FileIO) -> bool:
    """Return whether an open file has not been replaced by another, nor removed and made anew."""
    try:
        return os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return True  # removed: nobody writes it
