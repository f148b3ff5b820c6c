"""Processes: started so that neither Ctrl-C at the terminal nor the program's end ends them, and known again."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TypedDict

import psutil

_NICENESS = -10

_SAME_S = 2.0
"""Two accounts of when a process began may differ so much: the system rounds both of them to seconds, s."""


class StartOptions(TypedDict, total=False):
    """Options of subprocess.Popen that differ between systems."""

    start_new_session: bool
    process_group: int
    creationflags: int
    pass_fds: Sequence[int]
    close_fds: bool


def own_session(hold_open: Sequence[int] = ()) -> StartOptions:
    """Options for a process outside the terminal's group: what is typed there goes to the program alone.

    ``hold_open``: file descriptors that the process is to hold open as well.
    """
    if sys.platform == "win32":
        import msvcrt

        for fd in hold_open:
            os.set_handle_inheritable(msvcrt.get_osfhandle(fd), True)
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP, "close_fds": not hold_open}
    return {"start_new_session": True, "pass_fds": tuple(hold_open)}


def own_group() -> StartOptions:
    """Options for a process that what is typed at the terminal does not reach, of this program's session.

    Linux shares the processors out by session (sched(7), autogroup). A program and what it works with hand to
    hand, thousands of times a minute, wait much less for each other within one.
    """
    if sys.platform == "win32":
        return {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    return {"process_group": 0}


def ask_for_priority() -> None:
    """Have this process, and those it starts, go before others where the system allows it.

    What moves the arm must not wait behind whatever keeps the computer busy. Windows grants it to everyone; Linux
    to root, and to whom `ulimit -e` allows it.
    """
    with contextlib.suppress(OSError, psutil.Error):
        if sys.platform == "win32":
            psutil.Process().nice(psutil.HIGH_PRIORITY_CLASS)
            return
        os.setpriority(os.PRIO_PROCESS, 0, _NICENESS)
        if os.getsid(0) == os.getpid():
            # processes are weighed within their session first; this one has a session of its own
            Path("/proc/self/autogroup").write_text(f"{_NICENESS}", encoding="ascii")


def started_s(process: psutil.Process) -> float:
    """When a process began, s, by a count that no change of the clock moves: what it is known by, with its number."""
    # counted on Linux from the start of the computer, and only told by the clock
    counted_from_s = psutil.boot_time() if sys.platform == "linux" else 0.0
    return float(process.create_time() - counted_from_s)


def runs(pid: int, began_s: float | None = None) -> bool:
    """Whether a process runs, is no corpse, and (``began_s``, see `started_s`) is the one that was meant."""
    try:
        process = psutil.Process(pid)
        same = began_s is None or abs(started_s(process) - began_s) < _SAME_S
        return same and process.status() not in {psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD}
    except psutil.Error:
        return False
