"""How a helper process is started so that Ctrl-C at the terminal, and the program's end, do not end it."""

from __future__ import annotations

import subprocess
import sys
from typing import TypedDict


class SessionOptions(TypedDict, total=False):
    """Options of subprocess.Popen that differ between systems."""

    start_new_session: bool
    creationflags: int


def own_session() -> SessionOptions:
    """Options for a process outside the terminal's group: what is typed there goes to the program alone."""
    if sys.platform == "win32":
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    return {"start_new_session": True}
