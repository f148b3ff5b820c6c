"""Which trial files a user means: files and folders on the command line."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from analysis.errors import BadInputError


def find_trials(paths: Sequence[Path]) -> list[Path]:
    """Return the trial files named, and the `*.h5` of the folders named (subfolders too), sorted.

    Raises BadInputError where a name does not exist or nothing is found.
    """
    found: set[Path] = set()
    for path in map(Path, paths):
        if path.is_dir():
            found.update(p for p in path.rglob("*.h5") if p.is_file() and not p.name.startswith("."))
        elif path.exists():
            found.add(path)
        else:
            raise BadInputError(f"{path}: no such file or folder: check the name")
    if not found:
        named = ", ".join(str(path) for path in paths) or "nothing"
        raise BadInputError(f"{named}: holds no trial files (*.h5): give trial files or a folder of them")
    return sorted(found)
