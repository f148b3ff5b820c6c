"""A line to the person at the bench, from a process that has more to do than to wait until it is read."""

from __future__ import annotations

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


def _write(fd: int | None, line: str) -> None:
    # nobody listens there any more: the log has it as well
    with contextlib.suppress(OSError):
        if fd is not None:
            os.write(fd, line.encode())
        elif sys.platform == "win32":
            Path("CONOUT$").write_text(line, encoding="utf-8")
