"""A trial file holds its own data: one that points to other files would read whatever a stranger named there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py

from analysis.recordings.opening import access, bad_input

_MOST_OBJECTS = 10_000


def refuse_foreign_storage(path: Path, file: Any) -> None:
    """Raise BadInputError where any link, dataset or mapping of an open file leads to another file.

    External links, virtual datasets and external storage are refused wherever they stand, also where nothing
    reads them: a copy of the file would follow them.
    """
    seen: set[int] = set()
    groups = [("", file)]
    while groups:
        where, group = groups.pop()
        for name in group:
            place = f"{where}/{name}"
            with access(path, place):
                link = group.get(name, getlink=True)
                if isinstance(link, h5py.ExternalLink):
                    raise bad_input(path, place, "is a link to another file", "copy the data into this one")
                if not isinstance(link, h5py.HardLink):
                    continue  # a soft link leads to something that has a hard one, or to nothing
                item = group[name]
                if isinstance(item, h5py.Dataset) and (item.is_virtual or item.external):
                    raise bad_input(
                        path, place, "keeps its data in another file", "copy the data into this one"
                    )
                key = h5py.h5o.get_info(item.id).addr
            if key in seen:
                continue
            seen.add(key)
            if len(seen) > _MOST_OBJECTS:
                raise bad_input(path, "/", f"holds more than {_MOST_OBJECTS} objects", "it is no trial file")
            if isinstance(item, h5py.Group):
                groups.append((place, item))
