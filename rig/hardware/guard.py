"""The guard as the program sees it: a process that moves the arm away when the program dies.

It is started before the arm moves, holds a pipe to the program, and hears where the arm is and a
heartbeat. Its side of the pipe is `rig.hardware.guard_process`.
"""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import asdict
from types import TracebackType
from typing import IO, Self

from analysis.recordings.trial import Calibration
from rig.hardware.errors import GuardError
from rig.hardware.processes import own_session
from rig.settings.rig_file import RigFile

_log = logging.getLogger(__name__)

_START_S = 30.0
_BEATS_PER_TIMEOUT = 6


class Guard:
    """The guard, as a context manager; leave it only after the lever.

    ``hold_open``: descriptors it keeps open while it lives (the companion's stdin), so that what it
    needs outlives the program.
    """

    def __init__(
        self, rig: RigFile, card_address: str, calibration: Calibration, hold_open: Sequence[int] = ()
    ) -> None:
        self._orders = {
            "rig": rig.model_dump(mode="json", include={"card", "lever", "guard"}),
            "card_address": card_address,
            "calibration": asdict(calibration) | {"standard_errors": {}},
            "program": os.getpid(),
        }
        self._period_s = rig.guard.heartbeat_timeout_s / _BEATS_PER_TIMEOUT
        self._hold_open = hold_open
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the guard
        self._process: subprocess.Popen[bytes] | None = None
        self._sending = threading.Lock()
        self._ended = threading.Event()
        self._away = False

    def __enter__(self) -> Self:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "rig.hardware.guard_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            bufsize=0,  # a word is sent or it is not: none waits in a buffer for a pipe that has broken
            **own_session(self._hold_open),
        )
        try:
            self._send(json.dumps(self._orders))
            self._wait_until_ready(self._process)
        except GuardError:
            self._process.kill()
            self._close(self._process)
            raise
        threading.Thread(target=self._beat, name="heartbeat", daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        process = self._process
        if process is None:
            return
        try:
            if not self._away:
                self._send("end")
        except GuardError as failure:
            _log.warning("%s", failure)
        finally:
            # without "end" the closed pipe tells the guard to move the arm
            self._close(process)

    def _close(self, process: subprocess.Popen[bytes]) -> None:
        """Close the pipes and wait for the guard's end."""
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.close()
        process.wait()
        process.stdout.close()
        self._errors.close()

    @property
    def pid(self) -> int:
        """The guard's process."""
        if self._process is None:
            raise GuardError("the guard does not run; start it first")
        return self._process.pid

    def arm_away(self) -> None:
        """Tell that the arm is about to leave the safe position; GuardError where the guard is gone."""
        self._away = True
        self._send("away")

    def arm_safe(self) -> None:
        """Tell that the arm rests at the safe position."""
        self._send("safe")
        self._away = False

    def _send(self, word: str) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        try:
            with self._sending:
                self._process.stdin.write(word.encode() + b"\n")
        except (OSError, ValueError) as error:
            raise GuardError(
                "the guard process is gone, so the arm is not moved any further; start the run again"
            ) from error

    def _beat(self) -> None:
        while not self._ended.wait(self._period_s):
            try:
                self._send("beat")
            except GuardError:
                return

    def _wait_until_ready(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        stdout = process.stdout
        line: list[bytes] = []
        reader = threading.Thread(target=lambda: line.append(stdout.readline()), daemon=True)
        reader.start()
        reader.join(_START_S)
        if line and line[0].strip() == b"ready":
            return
        process.kill()
        process.wait()
        reader.join()
        self._errors.seek(0)
        said = self._errors.read().decode("utf-8", "replace").strip().splitlines()
        # the last line of a traceback, without the name of the exception's class
        reason = said[-1].partition("Error: ")[2] or said[-1] if said else "no reason given"
        raise GuardError(f"the guard process did not start: {reason}")
