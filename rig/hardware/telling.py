"""A line to the person at the bench, from a process that has no terminal of its own."""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path


def tell_person(fd: int | None, text: str) -> None:
    """Write a line where the program's own errors go; ``fd``: that descriptor, None: the console window."""
    line = f"\nindenter: {text}\n"
    # nobody listens there any more: the log has it as well
    with contextlib.suppress(OSError):
        if fd is not None:
            os.write(fd, line.encode())
        elif sys.platform == "win32":
            Path("CONOUT$").write_text(line, encoding="utf-8")
