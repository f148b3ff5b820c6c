"""Whether another process is writing a trial file: an advisory lock that dies with its process.

POSIX record locks, because a forked child does not inherit them: a guard process that outlives a killed
writer does not keep its file locked. On Windows an open file can't be replaced, which protects it as well.
"""

from __future__ import annotations

import os
import sys
from io import FileIO
from pathlib import Path


def lock(file: FileIO) -> None:
    """Take the lock of a file open for writing; BlockingIOError where another process holds it.

    File systems without locks are no reason not to record: there the lock is left out.
    """
    if sys.platform != "win32":
        import fcntl

        try:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise
        except OSError:
            return


def is_locked(path: Path) -> bool:
    """Return whether another process holds the lock of a file."""
    if sys.platform == "win32" or not os.access(path, os.W_OK):
        return False
    with path.open("rb+", buffering=0) as file:
        try:
            lock(file)
        except (BlockingIOError, PermissionError):
            return True
    return False
