"""Reading the tables of a trial file: phases, events and the log."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from analysis.errors import BadInputError
from analysis.recordings.attributes import text_of
from analysis.recordings.checks import phases_problem
from analysis.recordings.opening import access, bad_input
from analysis.recordings.trial import Event, Phase

_MAX_ROWS = 1_000_000


def _table(path: Path, file: Any, name: str, fields: tuple[str, ...]) -> NDArray[Any] | None:
    with access(path, f"/{name}"):
        dataset = file.get(name)
        if not isinstance(dataset, h5py.Dataset):
            return None
        names = dataset.dtype.names or ()
        if dataset.ndim != 1 or any(field not in names for field in fields) or len(dataset) > _MAX_ROWS:
            raise bad_input(
                path, f"/{name}", f"is not a table of {', '.join(fields)}", "write it as formats.md says"
            )
        rows: NDArray[Any] = dataset[()]
        return rows


def _whole(path: Path, where: str, raw: Any) -> int:
    value = raw.item() if isinstance(raw, np.generic) else raw
    if isinstance(value, bool) or not isinstance(value, int | float) or int(value) != value:
        raise bad_input(path, where, f"has {value!r:.40} for a sample", "it must be a whole number")
    return int(value)


def read_phases(path: Path, file: Any, n_samples: int, *, clip: bool) -> tuple[Phase, ...]:
    """Return the phases in order; empty ones say nothing and are left away.

    `clip` is for a file that was cut off: phases end with the samples, and a row half-written at that
    moment, and what follows it, is left away.
    """
    rows = _table(path, file, "phases", ("name", "start", "stop"))
    if rows is None:
        raise bad_input(path, "/phases", "is missing", "it must list name, start and stop of each phase")
    phases: list[Phase] = []
    for number, row in enumerate(rows):
        try:
            phase = _phase(path, f"/phases row {number}", row)
        except BadInputError:
            if clip:
                break
            raise
        if clip:
            phase = Phase(phase.name, min(phase.start, n_samples), min(phase.stop, n_samples))
        if clip and phases_problem([*phases, phase], n_samples):
            break
        phases.append(phase)
    problem = phases_problem(phases, n_samples)
    if problem:
        raise bad_input(path, "/phases", problem, "write them in order, stop exclusive")
    return tuple(phase for phase in phases if phase.stop > phase.start)


def _phase(path: Path, where: str, row: Any) -> Phase:
    with access(path, where):
        name = text_of(path, where, row["name"])
        return Phase(name, _whole(path, where, row["start"]), _whole(path, where, row["stop"]))


def read_events(path: Path, file: Any, *, clip: bool) -> tuple[Event, ...]:
    """Return the events; a file without the table has none. `clip` is as for the phases."""
    rows = _table(path, file, "events", ("sample", "kind", "message"))
    events: list[Event] = []
    for number, row in enumerate(rows if rows is not None else ()):
        try:
            event = _event(path, f"/events row {number}", row)
        except BadInputError:
            if clip:
                break
            raise
        if event.kind or event.message:  # else a row that was not written yet
            events.append(event)
    return tuple(events)


def _event(path: Path, where: str, row: Any) -> Event:
    with access(path, where):
        kind, message = text_of(path, where, row["kind"]), text_of(path, where, row["message"])
        return Event(_whole(path, where, row["sample"]), kind, message)


def read_log(path: Path, file: Any) -> tuple[str, ...]:
    """Return the lines of the log; a file without it has none."""
    with access(path, "/log"):
        dataset = file.get("log")
        if not isinstance(dataset, h5py.Dataset) or dataset.shape is None:
            return ()
        lines = np.atleast_1d(dataset[()]).ravel()
        return tuple(text_of(path, "/log", line) for line in lines if isinstance(line, str | bytes))
