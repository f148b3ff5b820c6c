"""From the card to the file: a thread that writes every sample while the program does something else."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from types import TracebackType
from typing import Self

import numpy as np

from analysis.errors import BadInputError
from analysis.recordings import TrialWriter
from analysis.recordings.opening import reason_of
from analysis.recordings.trial import FloatArray
from rig.engine.errors import DiskSilentError, FilingError
from rig.hardware.lever import Chunk

PATIENCE_S = 30.0
"""A disk that has taken nothing for so long after the end of a trial is not waited for any more."""

_PAUSE_S = 0.01
"""Between two writes, so that many small chunks cost one write: a tenth of what a kill may cost."""


class TrialFile:
    """The file of one trial, as a context manager over its writer: what it can't write is a FilingError."""

    def __init__(self, writer: TrialWriter) -> None:
        self._writer = writer

    def __enter__(self) -> TrialWriter:
        return self._writer

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, DiskSilentError):
            return  # to write more there would wait as long
        try:
            self._writer.__exit__(kind, error, trace)
        except (OSError, BadInputError) as failure:
            began = f"; it began with: {error}" if error is not None else ""
            raise FilingError(_told(self._writer.path, failure) + began) from failure


def _told(path: Path, failure: Exception) -> str:
    """What happened to a trial that can't be written, and what is kept of it."""
    reason = reason_of(failure) if isinstance(failure, OSError) else str(failure).removeprefix(f"{path}: ")
    if not path.exists():
        return f"{path}: could not be written ({reason})"
    return (
        f"{path}: could not be written to its end ({reason}): make room, then bring back what is there by "
        f"`indenter rescue {path}`"
    )


class Filing:
    """Appends the chunks of one trial to its file, as a context manager; leaving it, all is written.

    `keep` and `note` never wait: neither the disk nor what the program's thread does (loading a waveform, changing
    the structure of the file) stands between the card and the next sample looked at, nor between two motions.
    What stopped the writing, a full disk, is raised by `check` and at the end; DiskSilentError there where the disk
    takes nothing for ``patience_s``.
    """

    def __init__(self, writer: TrialWriter, patience_s: float = PATIENCE_S) -> None:
        self._writer = writer
        self._patience_s = patience_s
        self._work: SimpleQueue[Chunk | Callable[[], None] | None] = SimpleQueue()
        self._afterwards: list[Callable[[], None]] = []
        self._ended = threading.Event()
        self._n: int | None = None
        self._command_v: FloatArray | None = None
        self._failure: BaseException | None = None
        # ended with the program, whatever the disk does
        self._thread = threading.Thread(target=self._write_all, name="filing", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()
        self._thread.join(self._patience_s)
        if self._thread.is_alive():
            began = f"; it began with: {error}" if error is not None else ""
            raise DiskSilentError(
                f"{self._writer.path}: the disk has taken nothing for {self._patience_s:g} s: when it answers again, "
                f"and this program has ended, bring back what is there by `indenter rescue {self._writer.path}`{began}"
            )
        if error is None:
            self.check()
        for write in self._afterwards:
            with suppress(*(() if self._failure is None else (OSError,))):  # which has been told
                write()
        if self._n is not None:
            self._writer.drop_after(self._n)
        if self._command_v is not None and self._failure is None:
            self._writer.correct_command(self._command_v[: self._writer.n_samples])

    def keep(self, chunk: Chunk) -> None:
        """Write the next samples of the trial, soon; after `end`, don't."""
        if not self._ended.is_set():
            self._work.put(chunk)

    def note(self, write: Callable[[], None]) -> None:
        """Have something else written, in its turn; after `end`, when all samples are."""
        if self._ended.is_set():
            self._afterwards.append(write)
        else:
            self._work.put(write)

    def check(self) -> None:
        """Raise what stopped the writing, if anything did."""
        if isinstance(self._failure, OSError):
            raise FilingError(_told(self._writer.path, self._failure)) from self._failure
        if self._failure is not None:
            raise self._failure

    def end(self, n: int | None = None, command_v: FloatArray | None = None) -> None:
        """Keep nothing that comes from now on, and of the trial no more than ``n`` samples; never waits.

        ``command_v``, (m,), V, takes the place of the first m commands: where no loop-back is wired the
        command is known exactly only when it has been said where the output stopped.
        """
        if self._ended.is_set():
            return
        self._n, self._command_v = n, command_v
        self._ended.set()
        self._work.put(None)

    def _write_all(self) -> None:
        try:
            while self._write():
                self._ended.wait(_PAUSE_S)
        except BaseException as failure:  # noqa: BLE001 - raised by `check`, in the program's thread
            self._failure = failure

    def _write(self) -> bool:
        """Write all that has come; False once it was the last."""
        work = [self._work.get()]
        while not self._work.empty():
            work.append(self._work.get())
        chunks = [each for each in work if isinstance(each, Chunk)]
        if chunks:
            self._writer.append(
                np.concatenate([chunk.position_v for chunk in chunks]),
                np.concatenate([chunk.force_v for chunk in chunks]),
                np.concatenate([chunk.command_v for chunk in chunks]),
            )
        for each in work:
            if each is not None and not isinstance(each, Chunk):
                each()
        return None not in work
