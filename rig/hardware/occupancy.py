"""One rig, one run: a lock that a run holds from its start to its end, prompts and rests included.

The system frees it when the last process that holds it has ended: the run, or the guards that bring its arm to
safety. The file says who they are. Where it is removed meanwhile, by whatever tidies up the folder of temporary
files, a name of the system's that nobody can remove still keeps others out (on Linux, which has such names).
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import socket
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Self

import psutil

from rig.errors import RigError
from rig.hardware.processes import runs, started_s

_POLL_S = 0.05

GUARDS_END_S = 5.0
"""So long the guards of a run that is over are waited for."""

_LONGEST_NOTE = 4096


class RigBusyError(RigError):
    """Another run has this rig."""


@dataclass(frozen=True, slots=True)
class Occupant:
    """Who has a rig: a run's process, when it began (see `started_s`, and in words), its guards, whether it is over."""

    pid: int
    began_s: float
    since: str
    guards: tuple[int, ...] = ()
    over: bool = False

    @property
    def alive(self) -> bool:
        """Whether the run itself still goes on: its process may have others before and after it."""
        return not self.over and runs(self.pid, self.began_s)

    @classmethod
    def this_process(cls) -> Self:
        """This run, from now on."""
        process = psutil.Process()
        return cls(process.pid, started_s(process), f"{datetime.now():%Y-%m-%d %H:%M:%S}")


class RigLock:
    """The lock of one rig, as a context manager. ``address`` resolved.

    Raises RigBusyError, with who has it, where another run goes on. Of a run that is over its guards are waited
    for; ``end_guards`` ends those that do not come to an end, for `indenter safe`.
    """

    def __init__(self, address: str, device: str, *, end_guards: bool = False) -> None:
        name = re.sub(r"[^A-Za-z0-9.]+", "-", f"{address}-{device}").strip("-")
        self._path = Path(tempfile.gettempdir()) / f"indenter-{name}.lock"
        self._end_guards = end_guards
        self._fd: int | None = None
        self._held: socket.socket | None = None
        self._guards: tuple[int, ...] = ()

    def __enter__(self) -> Self:
        self._fd = self._open()
        try:
            self._wait()
            self.note(())
        except BaseException:
            self._close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # whoever comes next waits for what is left of the guards, and not for this process
        self._write(over=True)
        self._close()

    @property
    def fds(self) -> tuple[int, ...]:
        """The descriptors that hold the lock: whoever inherits them holds the lock as well."""
        if self._held is None:
            return (self._file(),)
        return self._file(), self._held.fileno()

    def _file(self) -> int:
        if self._fd is None:
            raise RigError("the rig's lock is not held; take it first")
        return self._fd

    def note(self, guards: Sequence[int]) -> None:
        """Write into the file who has the rig, and the processes of its guards."""
        self._guards = tuple(guards)
        self._write(over=False)

    def _write(self, *, over: bool) -> None:
        mine = asdict(Occupant.this_process()) | {"guards": list(self._guards), "over": over}
        # a file of another user's can be locked, and not written
        with contextlib.suppress(OSError):
            os.ftruncate(self._file(), 0)
            os.lseek(self._file(), 0, os.SEEK_SET)
            os.write(self._file(), json.dumps(mine).encode())

    def _open(self) -> int:
        for flags in (os.O_RDWR, os.O_RDWR | os.O_CREAT, os.O_RDONLY):
            with contextlib.suppress(OSError):
                return os.open(self._path, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)
        raise RigError(
            f"{self._path}: the lock of the rig can't be opened: remove that file, or its permissions"
        )

    def _close(self) -> None:
        fd, self._fd = self._fd, None
        held, self._held = self._held, None
        if held is not None:
            held.close()
        if fd is not None:
            os.close(fd)

    def _wait(self) -> None:
        deadline_s = time.monotonic() + GUARDS_END_S
        while not self._taken():
            other = self._occupant()
            if other is not None and other.alive and other.pid != os.getpid():
                raise RigBusyError(
                    f"another run has this rig: process {other.pid}, since {other.since}; wait for its end, or stop "
                    "it with Ctrl-C where it runs"
                )
            if time.monotonic() > deadline_s:
                if self._end_guards and other is not None and other.guards:
                    self._end(other.guards)
                    self._end_guards, deadline_s = False, deadline_s + GUARDS_END_S
                    continue
                if other is None:
                    raise RigBusyError(
                        f"another run has this rig, and {self._path} does not say who: wait for its end, or stop it "
                        "with Ctrl-C where it runs"
                    )
                raise RigBusyError(
                    "a run that is over left its guard behind, which has not let go of the rig: run `indenter safe`"
                )
            time.sleep(_POLL_S)

    def _taken(self) -> bool:
        if sys.platform == "win32":
            import msvcrt

            with contextlib.suppress(OSError):
                msvcrt.locking(self._file(), msvcrt.LK_NBLCK, 1)
                return True
            return False
        import fcntl

        try:
            fcntl.flock(self._file(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return self._name_taken()

    def _name_taken(self) -> bool:
        """Take the name that stands for the rig beside its file, where the system has such names."""
        if sys.platform == "linux":
            held = socket.socket(socket.AF_UNIX)
            try:
                # a digest: such names are short, and those of servers need not be
                held.bind(b"\0indenter-" + hashlib.sha256(self._path.name.encode()).hexdigest().encode())
            except OSError:
                held.close()
                return False
            self._held = held
        return True

    def _occupant(self) -> Occupant | None:
        """Who has it, as the file says; None where it says nothing that can be read."""
        try:
            note = json.loads(self._path.read_text(encoding="utf-8")[:_LONGEST_NOTE])
            return Occupant(**note | {"guards": tuple(note["guards"])})
        except (OSError, ValueError, TypeError, KeyError):
            return None

    def _end(self, guards: Sequence[int]) -> None:
        """End the guards of a run that is over: processes that are guards, and no others of the same number."""
        for pid in guards:
            with contextlib.suppress(psutil.Error):
                process = psutil.Process(pid)
                if any(word.startswith("rig.hardware.") for word in process.cmdline()):
                    process.kill()
