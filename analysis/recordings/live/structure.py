"""What HDF5 writes of a running trial's file: its whole structure, at once, before the first sample."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np

from analysis.recordings.layout import RUNNING_SURFACE
from analysis.recordings.room import ask_for_room
from analysis.recordings.trial import Event, Trial
from analysis.recordings.writing import (
    event_rows,
    most_bytes,
    phase_rows,
    surface_row,
    writable,
    write_attributes,
)

PHASE_ROWS = 32
EVENT_ROWS = 512
MESSAGE_BYTES = 240
_FILLED_AT_ONCE = 1 << 20


def make_structure(
    part: Path, trial: Trial, names: Sequence[str], capacity: int, event_capacity: int
) -> dict[str, int]:
    """Write everything of a trial but its samples, and return the offset of each dataset's bytes in the file.

    ``names``: its signals, each of ``capacity`` samples that are not written yet. Raises OSError.
    """
    events = event_rows([shortened(event) for event in trial.events], event_capacity, MESSAGE_BYTES)
    ask_for_room(part, most_bytes(trial) + events.nbytes + 8 * capacity * len(names))
    with h5py.File(part, "w", libver="earliest") as file:
        write_attributes(file, trial)
        file["phases"] = phase_rows(trial.phases, PHASE_ROWS)
        file["events"] = events
        file[RUNNING_SURFACE] = surface_row(trial.surface)
        for name in names:
            dataset = file["signals"].create_dataset(name, (capacity,), dtype="<f8")
            for start in range(0, capacity, _FILLED_AT_ONCE):
                stop = min(start + _FILLED_AT_ONCE, capacity)
                dataset[start:stop] = np.full(stop - start, np.nan)
        file.flush()
        datasets = {name: file["signals"][name] for name in names}
        datasets[RUNNING_SURFACE] = file[RUNNING_SURFACE]
        datasets |= {"phases": file["phases"], "events": file["events"]}
        return {name: int(dataset.id.get_offset()) for name, dataset in datasets.items()}


def shortened(event: Event) -> Event:
    """Cut the event's texts to the width of the running file's table, between whole characters."""
    kind, message = writable(event.kind).encode()[:32], writable(event.message).encode()[:MESSAGE_BYTES]
    return Event(event.sample, kind.decode(errors="ignore"), message.decode(errors="ignore"))
