"""A line to the person at the bench, from a process that has more to do than to wait until it is read."""

from __future__ import annotations

import _thread
import contextlib
import os
import sys
import threading
from pathlib import Path

_PATIENCE_S = 0.1
"""A terminal takes a line in no time, unless it is held (Ctrl-S), or is a pipe that nobody empties."""


def tell_person(fd: int | None, text: str) -> None:
    """Write a line where the program's own errors go; ``fd``: that descriptor, None: the console window.

    Whether it is taken or not, the caller goes on: the arm does not wait for a reader.
    """
    writing = threading.Thread(target=_write, args=(fd, f"\nindenter: {text}\n"), daemon=True)
    writing.start()
    writing.join(_PATIENCE_S)


def person_fd() -> int | None:
    """Where the person looks: the descriptor of the program's own errors, None where it was started without."""
    try:
        fd = 2 if sys.__stderr__ is None else sys.__stderr__.fileno()
        os.fstat(fd)
    except (OSError, ValueError):
        return None
    return fd


def say_beside(text: str) -> None:
    """Write a line where the person looks and do not wait for it; in the midst of anything, a signal's handler too."""
    # no thread of the threading module: starting one takes locks that the program may hold just now
    _thread.start_new_thread(_write, (person_fd(), f"\n{text}\n"))


def _write(fd: int | None, line: str) -> None:
    # nobody listens there any more: the log has it as well
    with contextlib.suppress(OSError):
        if fd is not None:
            os.write(fd, line.encode())
        elif sys.platform == "win32":
            Path("CONOUT$").write_text(line, encoding="utf-8")
