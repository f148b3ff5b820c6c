"""The keeper of what concealed benches hide: a process that tells seals first, truths last."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from types import TracebackType
from typing import IO, Any, Self

from rig.errors import RigError
from rig.hardware.processes import own_session

MODULE = "sim_hardware.concealment.conceal"


@dataclass(frozen=True, slots=True)
class Opened:
    """One case opened: its text and salt, and what the text says."""

    text: str
    salt: str
    truth: dict[str, Any]


class Keeper:
    """A running keeper, as a context manager; the truth is in its memory alone until it is opened."""

    def __init__(
        self,
        cases: int,
        seed: int,
        study: Sequence[Mapping[str, str | float]],
        drawn: Callable[[int, str], None],
    ) -> None:
        """``study``: finger, site, repeat, depth_mm, rest_s of each trial; ``drawn`` is told each case and its seal."""
        self._cases, self._seed, self._drawn = cases, seed, drawn
        self._study = json.dumps(list(study))
        self._errors: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the keeper
        self._process: subprocess.Popen[str] | None = None
        self.seals: list[str] = []
        self.address = ""

    def __enter__(self) -> Self:
        command = [
            sys.executable,
            "-m",
            MODULE,
            "keep",
            "--cases",
            str(self._cases),
            "--seed",
            str(self._seed),
        ]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            **own_session(),
        )
        try:
            self._tell(self._study)
            while not self.address:
                said = self._line()
                if "seal" in said:
                    self.seals.append(str(said["seal"]))
                    self._drawn(int(said["case"]), self.seals[-1])
                else:
                    self.address = str(said["address"])
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._close()

    def companion(self, number: int) -> list[str]:
        """Return the command of the bench that hides a case: a rig's companion."""
        return ["{python}", "-m", MODULE, "bench", self.address, str(number)]

    def open(self) -> list[Opened]:
        """Open every case and check it against its seal; RigError where one does not fit."""
        self._tell("open")
        found = []
        for number, told in enumerate(self.seals):
            said = self._line()
            text, salt = str(said["truth"]), str(said["salt"])
            if hashlib.sha256(f"{salt}\n{text}".encode()).hexdigest() != told:
                raise RigError(f"case {number}: the opened truth does not fit its seal; the proof is void")
            found.append(Opened(text, salt, json.loads(text)))
        return found

    def _running(self) -> subprocess.Popen[str]:
        if self._process is None:
            raise RigError("the keeper of the concealed cases does not run; start it first")
        return self._process

    def _tell(self, line: str) -> None:
        process = self._running()
        assert process.stdin is not None
        with suppress(BrokenPipeError):  # a keeper that has ended says why when it is listened to
            process.stdin.write(f"{line}\n")
            process.stdin.flush()

    def _line(self) -> dict[str, Any]:
        process = self._running()
        assert process.stdout is not None
        line = process.stdout.readline()
        if not line:
            process.wait()
            self._errors.seek(0)
            words = self._errors.read().decode("utf-8", "replace").strip().splitlines()
            raise RigError(
                f"the keeper of the concealed cases ended (exit code {process.returncode}): "
                f"{words[-1] if words else 'no reason given'}"
            )
        said: dict[str, Any] = json.loads(line)
        return said

    def _close(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    with suppress(BrokenPipeError):  # what it was not told before it ended
                        pipe.close()
            try:
                process.wait(5.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._errors.close()
