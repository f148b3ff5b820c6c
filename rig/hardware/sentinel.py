"""The sentinel: tells the person to lift the arm where the program and both its guards are gone with it in use.

A process that can do nothing but listen and speak. On stdin "away" and "safe"; the program and its guards all hold
the other end, so that the pipe closes with the last of them, however it died. Whoever is left before that moves
the arm; after it nobody is, and the last word says whether the finger is free.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys

from rig.hardware.hearing import first_line
from rig.hardware.processes import own_session
from rig.hardware.telling import tell_person

_STDIN = 0
_END_S = 1.0
"""It ends with the second guard, which ends with the first: so long it is waited for, s."""


class Sentinel:
    """The sentinel as the program sees it. ``tell_fd``: where the person looks.

    Where it can't be heard by, being dead or full, the run goes on: it guards nothing.
    """

    def __init__(self, tell_fd: int) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "rig.hardware.sentinel", str(tell_fd)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            bufsize=0,
            **own_session([tell_fd]),
        )
        os.set_blocking(self.fd, False)

    @property
    def pid(self) -> int:
        """Its process."""
        return self._process.pid

    @property
    def fd(self) -> int:
        """The end of the pipe that all who can move the arm hold."""
        assert self._process.stdin is not None
        return self._process.stdin.fileno()

    def close(self) -> None:
        """Let go of the pipe; where others do not, it is ended."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def tell_sentinel(fd: int | None, word: str) -> None:
    """Say "away" or "safe"; never waits."""
    if fd is not None:
        with contextlib.suppress(OSError):
            os.write(fd, word.encode() + b"\n")


def main() -> int:
    """Listen until the pipe closes; 1 where the person was told."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    word = b""
    while line := first_line(_STDIN):
        word = line.strip()
    if word != b"away":
        return 0
    tell_person(
        int(sys.argv[1]),
        "the program and its guards are gone with the arm in use: LIFT IT BY HAND, then run `indenter safe`",
    )
    return 1


if __name__ == "__main__":
    sys.exit(main())
