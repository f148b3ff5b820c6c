"""The bench in a process of its own, as the window holds it: started, followed, asked, and missed when it dies."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from rig.engine.announcing import announcement_of
from rig.engine.following import Follower
from rig.engine.progress import Snapshot
from rig.hardware.processes import own_session

START_S = 60.0
"""A bench that has not announced itself by then will not."""


class RunnerProcess:
    """One bench process. Nothing here waits: `poll` is called again and again by the window's timer.

    `log` is the file that takes what the process writes: a pipe would fill, and hold the bench up.
    """

    def __init__(self, rig: Path, log: Path) -> None:
        self._log = log
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("ab") as file:
            self._log_start = file.tell()
            self._process: subprocess.Popen[bytes] = _start(rig, file)
        self._started = time.monotonic()
        self._heard = time.monotonic()
        self._follower: Follower | None = None
        self.snapshot: Snapshot | None = None

    @property
    def pid(self) -> int:
        """The process's number."""
        return self._process.pid

    @property
    def follower(self) -> Follower | None:
        """The open connection; None until the bench has announced itself."""
        return self._follower

    @property
    def silent_s(self) -> float:
        """How long nothing has been heard, s."""
        return time.monotonic() - self._heard

    @property
    def exit_code(self) -> int | None:
        """How the process ended; None while it lives."""
        return self._process.poll()

    def poll(self) -> Snapshot | None:
        """Return the newest snapshot if one has come since the last call."""
        if self._follower is None:
            announcement = announcement_of(self._process.pid)
            if announcement is None:
                return None
            try:
                self._follower = Follower(announcement)
            except (FileNotFoundError, ValueError):
                return None
            self._heard = time.monotonic()
        snapshot = self._follower.snapshot(0)
        if snapshot is not None:
            self.snapshot, self._heard = snapshot, time.monotonic()
        return snapshot

    def ask(self, do: str, **more: Any) -> str:
        """Send a request; return its id, "" where nobody is there to take it."""
        return "" if self._follower is None else self._follower.request(do, **more)

    def last_words(self) -> str:
        """Return why the process has ended: what ended it, else the last line that it wrote."""
        code = self.exit_code
        # it had no time to say anything: what the log holds are others' words
        if code is not None and code < 0:
            return f"it was ended from outside (signal {-code}, {signal.strsignal(-code)})"
        with self._log.open("rb") as file:
            file.seek(self._log_start)
            lines = file.read().decode("utf-8", "replace").strip().splitlines()
        return lines[-1].removeprefix("indenter: ") if lines else "no reason given"

    def let_go(self) -> None:
        """Close the lifeline: the bench stops what runs, takes the arm clear, and ends by itself."""
        if self._process.stdin is not None and not self._process.stdin.closed:
            self._process.stdin.close()

    def close(self, patience_s: float = 20.0) -> int | None:
        """Let go and wait for the end, no longer than `patience_s`; return the exit code, None if it lives."""
        self.let_go()
        try:
            code: int | None = self._process.wait(patience_s)
        except subprocess.TimeoutExpired:
            code = None
        self.forget()
        return code

    def forget(self) -> None:
        """Close the connection; the process is not waited for."""
        if self._follower is not None:
            self._follower.__exit__()
            self._follower = None

    def end_frozen(self) -> None:
        """End a process that does not answer; its guard then takes the arm clear."""
        self._process.send_signal(signal.SIGKILL if os.name == "posix" else signal.SIGTERM)


def _start(rig: Path, log: IO[bytes]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "rig.engine.serving", str(rig)],
        stdin=subprocess.PIPE,
        stdout=log,
        stderr=log,
        **own_session(),
    )


def wait_for(
    process: RunnerProcess, when: Callable[[Snapshot], bool], patience_s: float = START_S
) -> Snapshot:
    """Return the first snapshot for which `when` holds; for programs without a window. TimeoutError."""
    until = time.monotonic() + patience_s
    while time.monotonic() < until:
        snapshot = process.poll()
        if snapshot is not None and when(snapshot):
            return snapshot
        if process.exit_code is not None:
            raise TimeoutError(f"the bench has ended ({process.exit_code}): {process.last_words()}")
        time.sleep(0.005)
    raise TimeoutError(f"the bench did not come to it within {patience_s:g} s; it is {process.snapshot}")
