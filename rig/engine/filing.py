"""From the card to the file: a thread that writes every sample while the program does something else."""

from __future__ import annotations

import threading
from concurrent.futures import Future, ThreadPoolExecutor, wait
from pathlib import Path
from queue import SimpleQueue
from types import TracebackType
from typing import Self

import numpy as np

from analysis.errors import BadInputError
from analysis.recordings import TrialWriter
from analysis.recordings.trial import FloatArray
from rig.engine.errors import FilingError
from rig.hardware.lever import Chunk

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
        try:
            self._writer.__exit__(kind, error, trace)
        except (OSError, BadInputError) as failure:
            began = f"; it began with: {error}" if error is not None else ""
            raise FilingError(_told(self._writer.path, failure) + began) from failure


def _told(path: Path, failure: Exception) -> str:
    """What happened to a trial that can't be written, and what is kept of it."""
    reason = (isinstance(failure, OSError) and failure.strerror) or str(failure).removeprefix(f"{path}: ")
    if not path.exists():
        return f"{path}: could not be written ({reason})"
    return (
        f"{path}: could not be written to its end ({reason}): make room, then bring back what is there by "
        f"`indenter rescue {path}`"
    )


class Filing:
    """Appends the chunks of one trial to its file, as a context manager; leaving it, all is written.

    `keep` never waits: neither the disk nor what the program's thread does (loading a waveform, changing
    the structure of the file) stands between the card and the next sample looked at. What stopped the
    writing, a full disk, is raised by `check` and at the end.
    """

    def __init__(self, writer: TrialWriter) -> None:
        self._writer = writer
        self._chunks: SimpleQueue[Chunk | None] = SimpleQueue()
        self._ended = threading.Event()
        self._n: int | None = None
        self._command_v: FloatArray | None = None
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="filing")
        self._writing: Future[None] | None = None

    def __enter__(self) -> Self:
        self._writing = self._thread.submit(self._write)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()
        assert self._writing is not None
        wait([self._writing])
        self._thread.shutdown()
        if error is None:
            self.check()
        if self._n is not None:
            self._writer.drop_after(self._n)
        if self._command_v is not None and not self._writing.exception():
            self._writer.correct_command(self._command_v[: self._writer.n_samples])

    def keep(self, chunk: Chunk) -> None:
        """Write the next samples of the trial, soon; after `end`, don't."""
        if not self._ended.is_set():
            self._chunks.put(chunk)

    def check(self) -> None:
        """Raise what stopped the writing, if anything did."""
        if self._writing is not None and self._writing.done():
            try:
                self._writing.result()
            except OSError as failure:
                raise FilingError(_told(self._writer.path, failure)) from failure

    def end(self, n: int | None = None, command_v: FloatArray | None = None) -> None:
        """Keep nothing that comes from now on, and of the trial no more than ``n`` samples; never waits.

        ``command_v``, (m,), V, takes the place of the first m commands: where no loop-back is wired the
        command is known exactly only when it has been said where the output stopped.
        """
        if self._ended.is_set():
            return
        self._n, self._command_v = n, command_v
        self._ended.set()
        self._chunks.put(None)

    def _write(self) -> None:
        while True:
            chunks = [self._chunks.get()]
            while not self._chunks.empty():
                chunks.append(self._chunks.get())
            whole = [chunk for chunk in chunks if chunk is not None]
            if whole:
                self._writer.append(
                    np.concatenate([chunk.position_v for chunk in whole]),
                    np.concatenate([chunk.force_v for chunk in whole]),
                    np.concatenate([chunk.command_v for chunk in whole]),
                )
            if len(whole) < len(chunks):
                return
            self._ended.wait(_PAUSE_S)
