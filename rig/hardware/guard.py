"""The guard as the program sees it: a process that moves the arm away when the program dies.

It is started before the arm moves, holds a pipe to the program, and hears where the output may be, and that
engine and reader live. It reports back as often; when it falls silent the arm is brought to safety at once. It
keeps a second guard, which hears the program by a pipe of its own and acts where nobody else does. Their side of
the pipes is `rig.hardware.guard_process` and `rig.hardware.second_guard`. Where all three are gone the sentinel
tells the person.
"""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict
from types import TracebackType
from typing import IO, Self

from analysis.recordings.trial import Calibration
from rig.hardware.errors import GuardError
from rig.hardware.processes import own_session
from rig.hardware.sentinel import Sentinel, tell_sentinel
from rig.hardware.telling import person_fd
from rig.settings.rig_file import RigFile

_log = logging.getLogger(__name__)

_START_S = 30.0
_BEATS_PER_TIMEOUT = 6

_END_S = 5.0
_END_MOVING_S = 20.0
"""How long its end is waited for: with the arm safe, and where it is left to bring the arm to safety."""


class Guard:
    """The guard, as a context manager; leave it only after the lever.

    ``hold_open``: descriptors it keeps open while it lives (the companion's stdin, the rig's lock), so that
    what it needs outlives the program.
    """

    def __init__(
        self, rig: RigFile, card_address: str, calibration: Calibration, hold_open: Sequence[int] = ()
    ) -> None:
        self._hold_open = list(hold_open)
        self._tell_fd: int | None = None
        self._second_ear: int | None = None
        self._sentinel: Sentinel | None = None
        self._orders = {
            "rig": rig.model_dump(mode="json", include={"card", "lever", "guard"}),
            "card_address": card_address,
            "calibration": asdict(calibration) | {"standard_errors": {}},
            "program": os.getpid(),
        }
        self._timeout_s = rig.guard.heartbeat_timeout_s
        self._period_s = self._timeout_s / _BEATS_PER_TIMEOUT
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the guard
        self._process: subprocess.Popen[bytes] | None = None
        self._sending = threading.Lock()
        self._beaten_s: dict[str, float] = {}
        self._heard_s = self._checked_s = time.monotonic()
        self._fault = ""
        self._away = False
        self.pids: tuple[int, ...] = ()
        """Processes of the guards."""

    def __enter__(self) -> Self:
        hears_fd: int | None = None
        if sys.platform != "win32":
            # where the person looks: the guards write there when the program can't
            looks = person_fd()
            self._tell_fd = os.open(os.devnull, os.O_WRONLY) if looks is None else os.dup(looks)
            hears_fd, self._second_ear = os.pipe()
            os.set_blocking(self._second_ear, False)
            self._sentinel = Sentinel(self._tell_fd)
            self._hold_open += [self._tell_fd, hears_fd, self._sentinel.fd]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "rig.hardware.guard_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            bufsize=0,  # a word is sent or it is not: none waits in a buffer for a pipe that has broken
            **own_session(self._hold_open),
        )
        if hears_fd is not None:
            os.close(hears_fd)  # the guards have it
        try:
            orders = self._orders | {
                "tell_fd": self._tell_fd,
                "ear_fd": hears_fd,
                "sentinel_fd": self._sentinel_fd,
                "hold_open": self._hold_open,
            }
            self._write(self._process, json.dumps(orders))
            self._wait_until_ready(self._process)
        except GuardError:
            self._process.kill()
            self._close(self._process, _END_S)
            raise
        assert self._process.stdin is not None
        if sys.platform != "win32":
            # a guard that does not listen must not hold up who speaks to it
            os.set_blocking(self._process.stdin.fileno(), False)
        threading.Thread(target=self._listen, args=(self._process,), name="guard", daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        process = self._process
        if process is None:
            return
        if not self._away:
            self._tell("end")
        # without "end" the closed pipe tells the guard to move the arm
        self._close(process, _END_MOVING_S if self._away else _END_S)

    def _close(self, process: subprocess.Popen[bytes], patience_s: float) -> None:
        """Close the pipes and wait for the guard's end; one that does not come to it is ended."""
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.close()
        try:
            process.wait(patience_s)
        except subprocess.TimeoutExpired:
            _log.warning("the guard did not end within %g s, ending it", patience_s)
            process.kill()
            process.wait()
        process.stdout.close()
        self._errors.close()
        for fd in (self._tell_fd, self._second_ear):
            if fd is not None:
                os.close(fd)
        self._tell_fd = self._second_ear = None
        if self._sentinel is not None:
            self._sentinel.close()
            self._sentinel = None

    @property
    def _sentinel_fd(self) -> int | None:
        return None if self._sentinel is None else self._sentinel.fd

    @property
    def pid(self) -> int:
        """The guard's process."""
        if self._process is None:
            raise GuardError("the guard does not run; start it first")
        return self._process.pid

    def arm_away(self, low_v: float, high_v: float, safe_v: float) -> None:
        """Tell that the arm is about to move, between which voltages, and at which it is safe."""
        self._away = True
        tell_sentinel(self._sentinel_fd, "away")
        self._tell(f"away {low_v!r} {high_v!r} {safe_v!r}")

    def arm_safe(self) -> None:
        """Tell that the arm rests at the safe position."""
        self._tell("safe")
        tell_sentinel(self._sentinel_fd, "safe")
        self._away = False

    def beat(self, who: str) -> None:
        """Tell that the engine, or the reader, is alive; from its own thread, as often as it likes."""
        now_s = time.monotonic()
        if now_s - self._beaten_s.get(who, -1e9) >= self._period_s:
            self._beaten_s[who] = now_s
            self._tell(f"beat {who}")

    def check(self) -> None:
        """Raise GuardError where the guard is dead, alone, or has not reported for the heartbeat's timeout."""
        now_s = time.monotonic()
        if now_s - self._checked_s > self._timeout_s / 2:
            # this program stood still itself: what the guard said meanwhile has not been heard yet
            self._heard_s = now_s
        self._checked_s = now_s
        fault = self._fault
        if not fault and self._process is not None and self._process.poll() is not None:
            fault = "the guard process is gone"
        if not fault and now_s - self._heard_s > self._timeout_s:
            fault = f"the guard process has not reported for {self._timeout_s:g} s"
        if fault:
            raise GuardError(f"{fault}, so the arm is not moved any further; start the run again")

    def _tell(self, words: str) -> None:
        """Send words to both guards; that they can't be sent is seen by `check`."""
        assert self._process is not None
        try:
            self._write(self._process, words)
        except GuardError as error:
            self._fault = self._fault or str(error)
        if self._second_ear is None:
            return  # the first passes them on
        try:
            os.write(self._second_ear, words.encode() + b"\n")  # short enough to go whole, or not at all
        except OSError:
            self._fault = self._fault or "the second guard does not listen"

    def _write(self, process: subprocess.Popen[bytes], words: str) -> None:
        assert process.stdin is not None
        try:
            with self._sending:
                process.stdin.write(words.encode() + b"\n")
        except (OSError, ValueError) as error:
            raise GuardError("the guard process is gone") from error

    def _listen(self, process: subprocess.Popen[bytes]) -> None:
        """Hear the guard's reports until its end."""
        assert process.stdout is not None
        try:
            for line in process.stdout:
                self._heard_s = time.monotonic()
                if line.strip() == b"alone":
                    self._fault = self._fault or "the second guard is gone"
        except ValueError:
            return  # closed on the way out
        self._fault = self._fault or "the guard process is gone"

    def _wait_until_ready(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        stdout = process.stdout
        line: list[bytes] = []
        reader = threading.Thread(target=lambda: line.append(stdout.readline()), daemon=True)
        reader.start()
        reader.join(_START_S)
        if line and line[0].startswith(b"ready"):
            self.pids = (process.pid, *(int(word) for word in line[0].split()[1:]))
            self._heard_s = time.monotonic()
            return
        process.kill()
        process.wait()
        reader.join()
        self._errors.seek(0)
        said = self._errors.read().decode("utf-8", "replace").strip().splitlines()
        # the last line of a traceback, without the name of the exception's class
        reason = said[-1].partition("Error: ")[2] or said[-1] if said else "no reason given"
        raise GuardError(f"the guard process did not start: {reason}")
