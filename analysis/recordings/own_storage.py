"""A trial file holds its own data: one that points to other files would read whatever a stranger named there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py

from analysis.errors import BadInputError
from analysis.recordings.opening import access, bad_input

_MOST_OBJECTS = 10_000


class ForeignStorageError(BadInputError):
    """A trial file leads to another file."""


def refuse_foreign_storage(path: Path, file: Any, *, cut: bool = False) -> None:
    """Raise BadInputError where any link, dataset or mapping of an open file leads to another file.

    External links, virtual datasets and external storage are refused wherever they stand, also where nothing
    reads them: a copy of the file would follow them. Of a file that was ``cut``, what is gone is passed over.
    """
    seen: set[int] = set()
    groups = [("", file)]
    while groups:
        where, group = groups.pop()
        try:
            with access(path, where or "/"):
                names = list(group)
        except BadInputError:
            if cut:
                continue
            raise
        for name in names:
            place = f"{where}/{name}"
            try:
                with access(path, place):
                    item = _own(path, place, group, name)
                    key = 0 if item is None else h5py.h5o.get_info(item.id).addr
            except ForeignStorageError:
                raise
            except BadInputError:
                if cut:
                    continue
                raise
            if item is None:
                continue
            if key in seen:
                continue
            seen.add(key)
            if len(seen) > _MOST_OBJECTS:
                raise bad_input(path, "/", f"holds more than {_MOST_OBJECTS} objects", "it is no trial file")
            if isinstance(item, h5py.Group):
                groups.append((place, item))


def _own(path: Path, place: str, group: Any, name: str) -> Any:
    """Return what a name of a group stands for; None for a soft link, which leads to what has a name of its own."""
    link = group.get(name, getlink=True)
    if isinstance(link, h5py.ExternalLink):
        raise ForeignStorageError(f"{path}: {place} is a link to another file: copy the data into this one")
    if not isinstance(link, h5py.HardLink):
        return None
    item = group[name]
    if isinstance(item, h5py.Dataset) and (item.is_virtual or item.external):
        raise ForeignStorageError(
            f"{path}: {place} keeps its data in another file: copy the data into this one"
        )
    return item
