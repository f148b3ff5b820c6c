"""The writer of finished trial files: whole or not at all."""

from __future__ import annotations

import glob
import math
import os
import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from analysis.errors import BadInputError
from analysis.recordings.checks import phases_problem, samples_problem
from analysis.recordings.layout import (
    FORMAT,
    FORMAT_VERSION,
    NATIVE_SIGNALS,
    RUNNING_SURFACE,
    SIGNALS,
    Attribute,
    attributes_of,
)
from analysis.recordings.opening import reason_of
from analysis.recordings.reading import read_trial
from analysis.recordings.room import ask_for_room
from analysis.recordings.sealing import seal
from analysis.recordings.trial import Event, Phase, Surface, Trial

SOFTWARE = "indenter"
_BESIDE_SAMPLES = 1 << 20
"""Room for all else that a trial file holds: a hundred attributes, phases, and what HDF5 keeps of its own, bytes."""
_LEFTOVER_S = 60.0  # no file is half-written for so long by a process that lives


@cache
def software_version() -> str:
    """Return the installed version of this program, empty where it is not installed."""
    try:
        return metadata.version(SOFTWARE)
    except metadata.PackageNotFoundError:
        return ""


def write_trial(path: Path, trial: Trial) -> None:
    """Write a finished trial in one go: beside its place first, then moved there whole.

    A file that stands there is replaced. Raises BadInputError where the trial breaks the layout or the
    place can't be written.
    """
    path = Path(path)
    check_trial(path, trial)
    with _told(path), replacing(path) as part:
        ask_for_room(part, most_bytes(trial))
        with h5py.File(part, "w", libver="earliest") as file:
            write_contents(file, trial)


@contextmanager
def _told(path: Path) -> Iterator[None]:
    """Translate what a disk refuses into one line."""
    try:
        yield
    except OSError as error:
        raise BadInputError(
            f"{path}: can't be written ({reason_of(error)}): check the folder and its space"
        ) from error


def check_trial(path: Path, trial: Trial) -> None:
    """Raise BadInputError where the reader would refuse what is to be written."""
    check_attributes(path, trial)
    lengths = {name: len(values) for name in SIGNALS if (values := getattr(trial, name)) is not None}
    problems = {f"/signals/{name}": samples_problem(getattr(trial, name)) for name in lengths}
    problems["/phases"] = phases_problem(trial.phases, trial.n_samples)
    if len(set(lengths.values())) != 1 or not trial.n_samples:
        problems["/signals"] = f"need equal lengths above 0, not {lengths}"
    for where, problem in problems.items():
        if problem:
            raise BadInputError(f"{path}: {where} {problem}: the trial is not written")


def check_attributes(path: Path, trial: Trial) -> None:
    """Raise BadInputError where the reader would refuse an attribute of a trial."""
    for group, values in _values(trial).items():
        for attribute, value in _stated(group, values):
            wrong = attribute.check(value) if attribute.check else None
            if wrong:
                raise BadInputError(f"{path}: {attribute.where} is {value!r:.60}: it {wrong}")


def replace_trial(path: Path, trial: Trial) -> None:
    """Write a trial in the place of its file, and take over what else that file holds.

    Attributes and groups that the layout does not know stay as they were; nothing of the file is lost.
    """
    path = Path(path)
    with replacing(path) as part:
        ask_for_room(part, most_bytes(trial) + path.stat().st_size)
        with h5py.File(path, "r") as old, h5py.File(part, "w", libver="earliest") as new:
            write_contents(new, trial)
            _take_over(old, new)


def _take_over(old: Any, new: Any) -> None:
    for name, value in old.attrs.items():
        if name not in new.attrs:
            new.attrs[name] = value
    for name in old:
        if name == RUNNING_SURFACE.split("/", maxsplit=1)[0]:
            continue  # a finished file says it in its attributes
        if name not in new:
            old.copy(name, new)
        elif isinstance(old[name], h5py.Group) and isinstance(new[name], h5py.Group):
            _take_over(old[name], new[name])


def mark_discarded(path: Path, reason: str) -> None:
    """Mark a trial as discarded, with the reason; the recording stays as it is."""
    if not reason.strip():
        raise BadInputError(f"{path}: discarding a trial needs a reason: say why it is not used")
    read_trial(path)
    with _told(path), replacing(Path(path)) as part:
        shutil.copyfile(path, part)
        ask_for_room(part, _BESIDE_SAMPLES)
        with h5py.File(part, "r+") as file:
            file.attrs["discarded"] = reason


def take_back_discard(path: Path) -> None:
    """Count a trial again that was marked as discarded; the recording stays as it is."""
    read_trial(path)
    with _told(path), replacing(Path(path)) as part:
        shutil.copyfile(path, part)
        ask_for_room(part, _BESIDE_SAMPLES)
        with h5py.File(part, "r+") as file:
            file.attrs.pop("discarded", None)


@contextmanager
def replacing(path: Path, *, exclusive: bool = False, finished: bool = True) -> Iterator[Path]:
    """Yield the name of a file to write beside `path`; on success it takes that place, whole.

    `exclusive` raises FileExistsError where the place is taken. `finished` files are sealed, and on the
    disk before they take their place, so that they outlive a power cut and not only the process.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield part
        if finished:
            seal(part)
            with part.open("rb+") as file:
                os.fsync(file.fileno())
        if exclusive:
            _move_to_free_name(part, path)
        else:
            part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def remove_leftovers(path: Path) -> None:
    """Remove what a killed process left beside a file that it was about to replace."""
    for part in path.parent.glob(f".{glob.escape(path.name)}.*.part"):
        if time.time() - part.stat().st_mtime > _LEFTOVER_S:
            part.unlink(missing_ok=True)


def _move_to_free_name(part: Path, path: Path) -> None:
    """Give `part` the name `path` in one step, or raise FileExistsError where it is taken."""
    if os.name == "nt":
        part.rename(path)
        return
    try:
        path.hardlink_to(part)  # unlike a rename it never replaces
    except FileExistsError:
        raise
    except OSError as error:  # a file system without links, FAT for one
        if path.exists():
            raise FileExistsError(f"{path} exists") from error
        part.replace(path)


def most_bytes(trial: Trial) -> int:
    """Return how long the file of a trial can become, at most."""
    channels = [trial.position_v, trial.force_v, trial.command_v, *trial.other_channels.values()]
    if trial.native is not None:
        channels += [getattr(trial.native, name) for name in NATIVE_SIGNALS]
    n_samples = sum(len(values) for values in channels if values is not None)
    n_text = sum(
        len(writable(text).encode()) for text in (trial.protocol.toml, *trial.log, trial.status_reason)
    )
    return 8 * n_samples + event_rows(trial.events).nbytes + 2 * n_text + _BESIDE_SAMPLES


def write_contents(file: Any, trial: Trial) -> None:
    """Write every attribute and dataset of a trial into an open, empty file."""
    write_attributes(file, trial)
    signals = file["signals"]
    signals["position_v"] = np.asarray(trial.position_v, dtype=np.float64)
    signals["force_v"] = np.asarray(trial.force_v, dtype=np.float64)
    if trial.command_v is not None:
        signals["command_v"] = np.asarray(trial.command_v, dtype=np.float64)
    file["phases"] = phase_rows(trial.phases)
    file["events"] = event_rows(trial.events)
    if trial.native is not None:
        for name in NATIVE_SIGNALS:
            file[f"import/{name}"] = np.asarray(getattr(trial.native, name), dtype=np.float64)
    for name, values in trial.other_channels.items():
        file[f"import/channels/{name}"] = np.asarray(values, dtype=np.float64)


def write_attributes(file: Any, trial: Trial) -> None:
    """Write the groups, their attributes, the log and the protocol's text: all but samples and tables."""
    for group, values in _values(trial).items():
        target = file.require_group(group)
        for attribute, value in _stated(group, values):
            target.attrs[attribute.name] = np.int64(value) if attribute.type is int else value
    if trial.protocol.toml:
        file["protocol"].create_dataset("toml", data=writable(trial.protocol.toml), dtype=h5py.string_dtype())
    file.create_dataset(
        "log", data=np.array([*map(writable, trial.log)], dtype=object), dtype=h5py.string_dtype()
    )


def surface_row(surface: Surface | None) -> NDArray[np.float64]:
    """Return the surface as the row of a running file, (4,); NaN where it is not known yet."""
    if surface is None:
        return np.full(4, np.nan)
    return np.array(
        [surface.position_mm, surface.sample, surface.overshoot_um, surface.threshold_mn], dtype=np.float64
    )


def phase_rows(phases: Sequence[Phase], capacity: int = 0) -> NDArray[Any]:
    """Return the phases as the compound rows of the file, filled up with empty ones to `capacity`."""
    names = [phase.name.encode() for phase in phases]
    width = max([16, *map(len, names)])
    rows = np.zeros(
        max(len(names), capacity), dtype=[("name", f"S{width}"), ("start", "<i8"), ("stop", "<i8")]
    )
    for row, phase, name in zip(rows, phases, names, strict=False):
        row["name"], row["start"], row["stop"] = name, phase.start, phase.stop
    return rows


def event_rows(events: Sequence[Event], capacity: int = 0, message_width: int = 1) -> NDArray[Any]:
    """Return the events as the compound rows of the file, filled up with empty ones to `capacity`."""
    kinds = [writable(event.kind).encode() for event in events]
    messages = [writable(event.message).encode() for event in events]
    width = max([message_width, *map(len, messages)])
    rows = np.zeros(
        max(len(events), capacity),
        dtype=[("sample", "<i8"), ("kind", f"S{max([32, *map(len, kinds)])}"), ("message", f"S{width}")],
    )
    for row, event, kind, message in zip(rows, events, kinds, messages, strict=False):
        row["sample"], row["kind"], row["message"] = event.sample, kind, message
    return rows


def _values(trial: Trial) -> dict[str, dict[str, Any]]:
    """Return what a trial says of each group's attributes; None stands for not known."""
    root = _fields(trial, "/") | {"format": FORMAT, "format_version": FORMAT_VERSION}
    root["software"] = trial.software or SOFTWARE
    root["software_version"] = trial.software_version or software_version()
    root["discarded"] = trial.discarded or None
    errors = {f"{name}_se": error for name, error in trial.calibration.standard_errors.items()}
    values = {
        "/": root,
        "/signals": {"sample_rate_hz": trial.sample_rate_hz},
        "/calibration": _fields(trial.calibration, "/calibration") | errors,
        "/protocol": _fields(trial.protocol, "/protocol"),
        "/specimen": _fields(trial.specimen, "/specimen"),
    }
    if trial.surface is not None:
        values["/surface"] = _fields(trial.surface, "/surface")
    return values


def _fields(part: object, group: str) -> dict[str, Any]:
    return {a.name: getattr(part, a.name) for a in attributes_of(group) if hasattr(part, a.name)}


def _stated(group: str, values: dict[str, Any]) -> Iterator[tuple[Attribute, Any]]:
    """Yield the attributes that are known, in the table's order, each of its declared type."""
    for attribute in attributes_of(group):
        value = values.get(attribute.name)
        if value is None or (isinstance(value, float) and math.isnan(value) and not attribute.required):
            continue
        yield attribute, writable(str(value)) if attribute.type is str else attribute.type(value)


def writable(text: str) -> str:
    """Replace what HDF5 texts can't hold, NUL and lone surrogates: no run fails for a stray character."""
    return text.replace("\0", "\ufffd").encode("utf-8", "replace").decode()
