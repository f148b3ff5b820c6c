"""What a folder of trials holds: one short header a file, and an index of them kept on disk.

The index knows a file by its path, size and time of change: a second visit to a folder opens none of them.
"""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import h5py

from analysis.errors import BadInputError
from analysis.recordings.attributes import attributes_in, group_of
from analysis.recordings.live.locking import is_locked
from analysis.recordings.opening import access, check_is_file, open_file
from analysis.recordings.probing import probe
from analysis.recordings.sealing import is_sealed

INDEX_VERSION = 1
BEING_WRITTEN = "being written"

_WANTED = {
    "/": ("trial_id", "started", "kind", "status", "source", "discarded"),
    "/specimen": ("subject", "finger", "site", "repeat"),
    "/protocol": ("depth_mm", "ramp_speed_mm_s", "hold_s"),
}


@dataclass(frozen=True, slots=True)
class Header:
    """One row of the browser; ``problem`` says why a file can't be read, all else is then empty."""

    path: str
    size: int
    modified_ns: int
    trial_id: str = ""
    started: str = ""
    kind: str = ""
    status: str = ""
    source: str = ""
    discarded: str = ""
    subject: str = ""
    finger: str = ""
    site: str = ""
    repeat: int | None = None
    depth_mm: float | None = None
    ramp_speed_mm_s: float | None = None
    hold_s: float | None = None
    n_samples: int = 0
    sample_rate_hz: float = 0.0
    problem: str = ""

    @property
    def duration_s(self) -> float | None:
        """Length of the recording, s."""
        return self.n_samples / self.sample_rate_hz if self.sample_rate_hz else None


@dataclass(frozen=True, slots=True)
class Listing:
    """A folder's files: headers that the index knows, and the files still to be read."""

    folder: str
    known: tuple[Header, ...]
    unread: tuple[str, ...]


def list_folder(folder: Path) -> Listing:
    """Return the trial files of a folder and its subfolders. Raises BadInputError where it can't be read."""
    if not folder.is_dir():
        raise BadInputError(f"{folder}: no such folder: check the name")
    kept = _read_index(folder)
    known, unread = [], []
    for path, size, modified_ns in sorted(_trial_files(folder)):
        header = kept.get(path)
        if header is not None and (header.size, header.modified_ns) == (size, modified_ns):
            known.append(header)
        else:
            unread.append(path)
    return Listing(str(folder), tuple(known), tuple(unread))


def read_headers(paths: Sequence[str]) -> tuple[Header, ...]:
    """Return one header a file; a file that can't be read, or is being written, has one that says so."""
    return tuple(_header(Path(path)) for path in paths)


def read_first_headers(paths: Sequence[str], within_s: float) -> tuple[Header, ...]:
    """Return the headers of the first of these files: as many as are read in that time, one at least.

    Bounded by time and not by number, so that what is asked for meanwhile waits no longer on a slow disk or a
    busy processor, and a quick one is not kept waiting for its next orders.
    """
    until = time.monotonic() + within_s
    headers: list[Header] = []
    for path in paths:
        headers.append(_header(Path(path)))
        if time.monotonic() > until:
            break
    return tuple(headers)


def keep_index(folder: Path, headers: Sequence[Header]) -> None:
    """Write a folder's index; without room for it the folder is read anew the next time."""
    target = _index_file(folder)
    part = target.with_name(f"{target.name}.{os.getpid()}.part")
    settled = [asdict(header) for header in headers if header.problem != BEING_WRITTEN]
    document = {"version": INDEX_VERSION, "folder": str(folder), "headers": settled}
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        part.write_text(json.dumps(document), encoding="utf-8")
        part.replace(target)
    except OSError as error:
        raise BadInputError(
            f"{target}: the index can't be kept there ({error.strerror}): make room; trials are not affected"
        ) from error


def _trial_files(folder: Path) -> list[tuple[str, int, int]]:
    """Return path, size and time of change of every trial file below a folder."""
    found: list[tuple[str, int, int]] = []
    waiting = [str(folder)]
    while waiting:
        try:
            with os.scandir(waiting.pop()) as entries:
                for entry in entries:
                    if entry.name.startswith("."):
                        continue
                    if entry.is_dir(follow_symlinks=False):
                        waiting.append(entry.path)
                    elif entry.name.endswith(".h5"):
                        status = entry.stat()
                        found.append((entry.path, status.st_size, status.st_mtime_ns))
        except OSError as error:
            raise BadInputError(
                f"{error.filename}: can't be listed ({error.strerror}): check the folder's permissions"
            ) from error
    return found


def _header(path: Path) -> Header:
    try:
        status = path.stat()
        size, modified_ns = status.st_size, status.st_mtime_ns
    except OSError as error:
        return Header(str(path), 0, 0, problem=f"can't be opened ({error.strerror})")
    try:
        if is_locked(path):
            return Header(str(path), size, modified_ns, problem=BEING_WRITTEN)
        check_is_file(path)
        if not is_sealed(path):
            probe(path)  # the HDF5 library may crash on a damaged file of another program
        return Header(str(path), size, modified_ns, **_stated(path))
    except (BadInputError, OSError) as error:
        return Header(str(path), size, modified_ns, problem=str(error).removeprefix(f"{path}: "))


def _stated(path: Path) -> dict[str, Any]:
    with open_file(path) as file, access(path, "the file's structure"):
        values: dict[str, Any] = {}
        for name, only in _WANTED.items():
            group = file if name == "/" else file.get(name)
            if isinstance(group, h5py.Group):
                values |= attributes_in(path, group, name, only)
        signals = group_of(path, file, "signals")
        values |= attributes_in(path, signals, "/signals")
        values["n_samples"] = len(signals["position_v"])
    return values


def _index_file(folder: Path) -> Path:
    import platformdirs

    name = hashlib.sha256(str(folder.resolve()).encode()).hexdigest()[:24]
    return platformdirs.user_cache_path("indenter") / "indexes" / f"{name}.json"


def _read_index(folder: Path) -> dict[str, Header]:
    """Return the index by path; one that is missing, damaged or of another version is empty."""
    try:
        document = json.loads(_index_file(folder).read_text(encoding="utf-8"))
        if document["version"] != INDEX_VERSION:
            return {}
        names = {field.name for field in fields(Header)}
        return {row["path"]: Header(**row) for row in document["headers"] if set(row) == names}
    except (OSError, ValueError, KeyError, TypeError):
        return {}
