"""The crash-safe writer: a trial on disk, chunk by chunk, while it runs.

All of the file's structure is written at once when it is made: attributes, tables of fixed capacity and
contiguous signals filled with NaN. From then on HDF5 is not used: chunks, phases and events are written
as plain bytes at known offsets inside those datasets. A process that is killed leaves what it has written
in the system's page cache, and the structure was never half-changed, so that any HDF5 program opens the
file at any moment; what is not written yet is NaN. Signals that outgrow their capacity, and anything that
changes the structure, go through a whole new file that takes the old one's place in one step.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Any
from uuid import uuid4

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.errors import BadInputError
from analysis.recordings.checks import phases_problem
from analysis.recordings.layout import SIGNALS
from analysis.recordings.locking import lock
from analysis.recordings.trial import (
    Calibration,
    Event,
    FloatArray,
    Kind,
    Phase,
    ProtocolSummary,
    Source,
    Specimen,
    Status,
    Surface,
    Trial,
)
from analysis.recordings.writing import (
    check_attributes,
    event_rows,
    phase_rows,
    replacing,
    writable,
    write_attributes,
    write_trial,
)

_PHASE_ROWS = 32
_EVENT_ROWS = 128
_MESSAGE_BYTES = 240
_COPY_SAMPLES = 1 << 20


def _now() -> str:
    return datetime.now().astimezone().isoformat()


@dataclass(frozen=True, slots=True)
class TrialHeader:
    """What is known of a trial before its first sample."""

    kind: Kind
    source: Source
    sample_rate_hz: float
    calibration: Calibration
    protocol: ProtocolSummary = field(default_factory=ProtocolSummary)
    specimen: Specimen = field(default_factory=Specimen)
    log: tuple[str, ...] = ()
    trial_id: str = field(default_factory=lambda: str(uuid4()))
    started: str = field(default_factory=_now)
    software: str = ""
    software_version: str = ""


class TrialWriter:
    """Writes one trial file while the trial runs; readable by any HDF5 program after a kill.

    `max_samples` is the capacity reserved at once; a longer trial moves to a file of twice the capacity.
    As a context manager it finishes as ``aborted`` on an exception. Every append is on its way to disk
    when it returns. Raises BadInputError where the file exists already or can't be made.
    """

    def __init__(self, path: Path, header: TrialHeader, max_samples: int, *, commanded: bool = True) -> None:
        self.path = Path(path)
        self.header = header
        self.n_samples = 0
        self.phases: tuple[Phase, ...] = ()
        self.events: tuple[Event, ...] = ()
        self.surface: Surface | None = None
        self._log = header.log
        self._names = SIGNALS if commanded else SIGNALS[:2]
        self._capacity = max(1, int(max_samples))
        self._event_capacity = _EVENT_ROWS
        self._bytes: FileIO | None = None
        self._offsets: dict[str, int] = {}
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
            self._restructure(max(2 * self._capacity, self.n_samples + n))
        for name, chunk in zip(self._names, chunks, strict=True):
            self._put(self._offsets[name] + 8 * self.n_samples, chunk)
        self.n_samples += n

    def set_phases(self, phases: Sequence[Phase]) -> None:
        """Replace the phases known so far; they may reach beyond the samples written so far."""
        problem = phases_problem(phases, np.iinfo(np.int64).max)
        if problem or len(phases) > _PHASE_ROWS:
            raise ValueError(f"phases: {problem or f'more than {_PHASE_ROWS}'}")
        self.phases = tuple(phases)
        self._put(self._offsets["phases"], phase_rows(self.phases, _PHASE_ROWS))

    def add_event(self, event: Event) -> None:
        """Add an event; while the trial runs its message is kept to 240 bytes, in full once finished."""
        self.events = (*self.events, event)
        if len(self.events) > self._event_capacity:
            self._event_capacity *= 2
            self._restructure(self._capacity)
        row = event_rows([_shortened(event)], message_width=_MESSAGE_BYTES)
        self._put(self._offsets["events"] + row.nbytes * (len(self.events) - 1), row)

    def set_surface(self, surface: Surface) -> None:
        """Say where the skin was found."""
        self.surface = surface
        self._restructure(self._capacity)

    def add_log(self, line: str) -> None:
        """Add a line to the log; it is written when the trial is finished."""
        self._log = (*self._log, line)

    def finish(self, status: Status = "complete", reason: str = "") -> Path:
        """Close the recording: trim the file to the samples written and set how it ended.

        Phases are cut to the samples written. Without a single sample the file is removed and
        BadInputError says so.
        """
        if self._bytes is None:
            raise ValueError(f"{self.path}: the trial is finished already")
        if not self.n_samples:
            self._close()
            self.path.unlink(missing_ok=True)
            raise BadInputError(f"{self.path}: nothing was recorded, no file is left: start the trial again")
        channels = {name: self._read(name) for name in self._names}
        trial = replace(
            self._trial(status, reason),
            position_v=channels["position_v"],
            force_v=channels["force_v"],
            command_v=channels.get("command_v"),
            phases=_cut(self.phases, self.n_samples),
        )
        self._close()
        write_trial(self.path, trial)
        return self.path

    def __enter__(self) -> TrialWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bytes is None:
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
            log=self._log,
        )

    def _create(self) -> None:
        """Make the file whole under another name, then give it its own: it never stands there half-made."""
        check_attributes(self.path, self._trial("running"))
        try:
            with replacing(self.path, exclusive=True, finished=False) as part:
                offsets = self._structure(part)
        except FileExistsError as error:
            raise BadInputError(f"{self.path}: exists already: a trial never overwrites another") from error
        except OSError as error:
            reason = error.strerror or str(error)
            raise BadInputError(f"{self.path}: can't be made ({reason}): check the folder") from error
        self._offsets = offsets
        self._bytes = _opened(self.path)

    def _restructure(self, capacity: int) -> None:
        """Move to a new file of that capacity; the old one stands until the new one is whole."""
        if self._bytes is None:
            raise ValueError(f"{self.path}: the trial is finished already")
        self._capacity = capacity
        with replacing(self.path, finished=False) as part:
            offsets = self._structure(part)
            new = _opened(part)  # locked before it takes its place, so that the trial is never without
            try:
                self._copy_samples(new, offsets)
            except OSError:
                new.close()
                raise
            self._close()
            if sys.platform == "win32":
                new.close()  # an open file can't be moved there
        self._offsets = offsets
        self._bytes = _opened(self.path) if new.closed else new

    def _copy_samples(self, new: FileIO, offsets: dict[str, int]) -> None:
        for name in self._names:
            for start in range(0, self.n_samples, _COPY_SAMPLES):
                block = self._read(name, start, min(_COPY_SAMPLES, self.n_samples - start))
                _write_at(new, offsets[name] + 8 * start, block)

    def _structure(self, part: Path) -> dict[str, int]:
        """Write everything but the samples, and return the offset of each dataset's bytes."""
        with h5py.File(part, "w", libver="earliest") as file:
            write_attributes(file, self._trial("running"))
            file["phases"] = phase_rows(self.phases, _PHASE_ROWS)
            events = [_shortened(event) for event in self.events]
            file["events"] = event_rows(events, self._event_capacity, _MESSAGE_BYTES)
            for name in self._names:
                dataset = file["signals"].create_dataset(name, (self._capacity,), dtype="<f8")
                for start in range(0, self._capacity, _COPY_SAMPLES):
                    stop = min(start + _COPY_SAMPLES, self._capacity)
                    dataset[start:stop] = np.full(stop - start, np.nan)
            file.flush()
            datasets = {name: file["signals"][name] for name in self._names}
            datasets |= {"phases": file["phases"], "events": file["events"]}
            return {name: int(dataset.id.get_offset()) for name, dataset in datasets.items()}

    def _put(self, offset: int, values: NDArray[Any]) -> None:
        if self._bytes is None:
            raise ValueError(f"{self.path}: the trial is finished already")
        _write_at(self._bytes, offset, values)

    def _read(self, name: str, start: int = 0, count: int | None = None) -> FloatArray:
        assert self._bytes is not None
        count = self.n_samples if count is None else count
        self._bytes.seek(self._offsets[name] + 8 * start)
        values = np.empty(count, dtype="<f8")
        view = values.data.cast("B")
        filled = 0
        while filled < len(view):
            got = self._bytes.readinto(view[filled:])
            if not got:
                raise OSError(f"{self.path}: was cut short by another program while it was written")
            filled += got
        return values

    def _close(self) -> None:
        if self._bytes is not None:
            self._bytes.close()
            self._bytes = None


def _opened(path: Path) -> FileIO:
    file = path.open("rb+", buffering=0)
    lock(file)
    return file


def _write_at(file: FileIO, offset: int, values: NDArray[Any]) -> None:
    file.seek(offset, os.SEEK_SET)
    view = values.view(np.uint8).data
    while view:
        view = view[file.write(view) :]


def _shortened(event: Event) -> Event:
    """Cut the event's texts to the width of the running file's table, between whole characters."""
    kind, message = writable(event.kind).encode()[:32], writable(event.message).encode()[:_MESSAGE_BYTES]
    return Event(event.sample, kind.decode(errors="ignore"), message.decode(errors="ignore"))


def _cut(phases: Sequence[Phase], n_samples: int) -> tuple[Phase, ...]:
    cut = (Phase(p.name, min(p.start, n_samples), min(p.stop, n_samples)) for p in phases)
    return tuple(phase for phase in cut if phase.stop > phase.start)
