"""The crash-safe writer: a trial on disk, chunk by chunk, while it runs.

All of the file's structure is written at once when it is made: attributes, tables of fixed capacity and
contiguous signals filled with NaN. From then on HDF5 is not used: chunks, phases and events are written
as plain bytes at known offsets inside those datasets. A process that is killed leaves what it has written
in the system's page cache, and the structure was never half-changed, so that any HDF5 program opens the
file at any moment; what is not written yet is NaN. Signals that outgrow their capacity, and anything that
changes the structure, go through a whole new file that takes the old one's place in one step; chunks go on
being written to the old one until then. Where the skin was found is such plain bytes as well, in a dataset of
the running file alone, so that nothing is rewritten while the punch is in the skin.
"""

from __future__ import annotations

import errno
import sys
import tempfile
import threading
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import ArrayLike

from analysis.errors import BadInputError
from analysis.recordings.checks import phases_problem
from analysis.recordings.layout import RUNNING_SURFACE, SIGNALS
from analysis.recordings.live.header import TrialHeader
from analysis.recordings.live.running_file import RunningFile
from analysis.recordings.live.structure import (
    EVENT_ROWS,
    MESSAGE_BYTES,
    PHASE_ROWS,
    make_structure,
    shortened,
)
from analysis.recordings.opening import reason_of
from analysis.recordings.trial import (
    Event,
    Phase,
    Status,
    Surface,
    Trial,
)
from analysis.recordings.writing import (
    check_attributes,
    event_rows,
    phase_rows,
    replacing,
    surface_row,
    write_trial,
)

_COPY_SAMPLES = 1 << 20


class TrialWriter:
    """Writes one trial file while the trial runs; readable by any HDF5 program after a kill.

    `max_samples` is the capacity reserved at once; a longer trial moves to a file of twice the capacity.
    As a context manager it finishes as ``aborted`` on an exception. Every append is on its way to disk
    when it returns. One thread may append while another does the rest, up to `finish`: no append waits
    for a change of the structure that the other makes. With ``grow`` off a trial that outgrows what was
    reserved is refused (OSError) instead of moved. Raises BadInputError where the file exists already or
    can't be made.
    """

    def __init__(
        self,
        path: Path,
        header: TrialHeader,
        max_samples: int,
        *,
        commanded: bool = True,
        grow: bool = True,
    ) -> None:
        self.path = Path(path)
        self.header = header
        self.n_samples = 0
        self.phases: tuple[Phase, ...] = ()
        self.events: tuple[Event, ...] = ()
        self.surface: Surface | None = None
        self._names = SIGNALS if commanded else SIGNALS[:2]
        self._capacity = max(1, int(max_samples))
        self._grow = grow
        self._event_capacity = EVENT_ROWS
        self._file: RunningFile | None = None
        # who takes both takes the first one first
        self._shaping = threading.RLock()
        self._appending = threading.Lock()
        self._create()

    def append(self, position_v: ArrayLike, force_v: ArrayLike, command_v: ArrayLike | None = None) -> None:
        """Add a chunk: each channel (n,), V, of equal length. Raises ValueError on unequal or NaN chunks."""
        given = [position_v, force_v] if command_v is None else [position_v, force_v, command_v]
        chunks = [np.ascontiguousarray(chunk, dtype=np.float64) for chunk in given]
        n = chunks[0].size
        if len(chunks) != len(self._names) or any(chunk.shape != (n,) for chunk in chunks):
            raise ValueError(f"a chunk needs {len(self._names)} channels of equal length")
        if not all(np.isfinite(chunk).all() for chunk in chunks):
            raise ValueError("a chunk holds NaN or infinite samples")
        if self.n_samples + n > self._capacity:
            if not self._grow:
                raise OSError(errno.EFBIG, f"the trial is longer than the {self._capacity} samples reserved")
            self._restructure(max(2 * self._capacity, self.n_samples + n))
        with self._appending:
            file = self._running()
            for name, chunk in zip(self._names, chunks, strict=True):
                file.write(name, chunk, self.n_samples)
            self.n_samples += n

    def drop_after(self, n_samples: int) -> None:
        """Keep only so many samples; for what was recorded beyond the end of the trial."""
        self.n_samples = min(self.n_samples, n_samples)

    def correct_command(self, command_v: ArrayLike) -> None:
        """Replace the command from the first sample on, (n,), V, of samples appended already."""
        values = np.ascontiguousarray(command_v, dtype=np.float64)
        if values.size > self.n_samples or not np.isfinite(values).all():
            raise ValueError("the command to put in place is longer than the recording, or holds NaN")
        self._running().write(SIGNALS[2], values)

    def set_phases(self, phases: Sequence[Phase]) -> None:
        """Replace the phases known so far; they may reach beyond the samples written so far."""
        problem = phases_problem(phases, np.iinfo(np.int64).max)
        if problem or len(phases) > PHASE_ROWS:
            raise ValueError(f"phases: {problem or f'more than {PHASE_ROWS}'}")
        with self._shaping:
            self.phases = tuple(phases)
            self._running().write("phases", phase_rows(self.phases, PHASE_ROWS))

    def add_event(self, event: Event) -> None:
        """Add an event; while the trial runs its message is kept to 240 bytes, in full once finished."""
        with self._shaping:
            self.events = (*self.events, event)
            if len(self.events) > self._event_capacity:
                self._event_capacity *= 2
                self._restructure()
            row = event_rows([shortened(event)], message_width=MESSAGE_BYTES)
            self._running().write("events", row, len(self.events) - 1)

    def set_surface(self, surface: Surface) -> None:
        """Say where the skin was found."""
        with self._shaping:
            self.surface = surface
            self._running().write(RUNNING_SURFACE, surface_row(surface))

    def finish(self, status: Status = "complete", reason: str = "") -> Path:
        """Close the recording: trim the file to the samples written and set how it ended.

        Phases are cut to the samples written. Without a single sample the file is removed and
        BadInputError says so.
        """
        file = self._running()
        if not self.n_samples:
            self._close()
            self.path.unlink(missing_ok=True)
            raise BadInputError(f"{self.path}: nothing was recorded, no file is left: start the trial again")
        try:
            channels = {name: file.read(name, 0, self.n_samples) for name in self._names}
            trial = replace(
                self._trial(status, reason),
                position_v=channels["position_v"],
                force_v=channels["force_v"],
                command_v=channels.get("command_v"),
                phases=_cut(self.phases, self.n_samples),
            )
            self._write_finished(trial)
        finally:
            self._close()
        return self.path

    def _write_finished(self, trial: Trial) -> None:
        """Write the file whole; where its folder is gone meanwhile, another that is kept instead."""
        try:
            write_trial(self.path, trial)
        except BadInputError as error:
            if self.path.parent.is_dir():
                raise
            kept = Path(tempfile.gettempdir()) / f"{self.path.stem}-{trial.trial_id[:8]}.h5"
            write_trial(kept, replace(trial, status="aborted", status_reason=str(error)))
            raise BadInputError(f"{self.path}: its folder is gone: the trial was kept as {kept}") from error

    def __enter__(self) -> TrialWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is None:
            return
        if error is None:
            self.finish()
        elif self.n_samples:
            said = " ".join(str(error).split())
            self.finish("aborted", f"{type(error).__name__}: {said}" if said else type(error).__name__)
        else:
            self._close()
            self.path.unlink(missing_ok=True)

    def _trial(self, status: Status, reason: str = "") -> Trial:
        empty = np.empty(0)
        h = self.header
        return Trial(
            trial_id=h.trial_id,
            started=h.started,
            kind=h.kind,
            source=h.source,
            status=status,
            status_reason=reason,
            software=h.software,
            software_version=h.software_version,
            sample_rate_hz=h.sample_rate_hz,
            position_v=empty,
            force_v=empty,
            command_v=empty,
            calibration=h.calibration,
            phases=self.phases,
            surface=self.surface,
            protocol=h.protocol,
            specimen=h.specimen,
            events=self.events,
            log=h.log,
        )

    def _create(self) -> None:
        """Make the file whole under another name, then give it its own: it never stands there half-made."""
        check_attributes(self.path, self._trial("running"))
        try:
            with replacing(self.path, exclusive=True, finished=False) as part:
                offsets = self._structure(part, self._capacity)
        except FileExistsError as error:
            raise BadInputError(f"{self.path}: exists already: a trial never overwrites another") from error
        except OSError as error:
            raise BadInputError(
                f"{self.path}: can't be made ({reason_of(error)}): check the folder"
            ) from error
        self._file = RunningFile(self.path, offsets)

    def _restructure(self, capacity: int = 0) -> None:
        """Move to a new file of that capacity at least; the old one stands until the new one is whole."""
        with self._shaping, ExitStack() as held:
            old = self._running()
            capacity = max(capacity, self._capacity)
            with replacing(self.path, finished=False) as part:
                offsets = self._structure(part, capacity)
                new = RunningFile(part, offsets)  # locked before it takes its place: never without
                unless_done = held.enter_context(ExitStack())
                unless_done.callback(new.close)
                copied = self._copy_samples(old, new, 0)
                # what came meanwhile is little; nothing is appended from here until the new file stands
                held.enter_context(self._appending)
                self._copy_samples(old, new, copied)
                if sys.platform == "win32":
                    self._close()  # an open file can't be moved there
                    new.close()
            if sys.platform == "win32":
                new = RunningFile(self.path, offsets)
            self._file, self._capacity = new, capacity
            unless_done.pop_all()
        old.close()

    def _copy_samples(self, old: RunningFile, new: RunningFile, first: int) -> int:
        """Copy the samples from `first` on; return the number of the first that was not there yet."""
        end = self.n_samples
        for name in self._names:
            for start in range(first, end, _COPY_SAMPLES):
                stop = min(start + _COPY_SAMPLES, end)
                new.write(name, old.read(name, start, stop), start)
        return end

    def _structure(self, part: Path, capacity: int) -> dict[str, int]:
        return make_structure(part, self._trial("running"), self._names, capacity, self._event_capacity)

    def _running(self) -> RunningFile:
        if self._file is None:
            raise ValueError(f"{self.path}: the trial is finished already")
        return self._file

    def _close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None


def _cut(phases: Sequence[Phase], n_samples: int) -> tuple[Phase, ...]:
    cut = (Phase(p.name, min(p.start, n_samples), min(p.stop, n_samples)) for p in phases)
    return tuple(phase for phase in cut if phase.stop > phase.start)
