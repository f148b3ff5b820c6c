"""Solved pads on disk, found again by what went into them."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from analysis.errors import BadInputError
from analysis.fingertip.pad_file import PadFile

_LAYOUT = 3
"""Raised whenever what is solved for or stored changes."""


def cache_folder(given: Path | None) -> Path:
    """Return the folder of solved pads: the one given, or the user's own cache."""
    if given is not None:
        return given
    from platformdirs import user_cache_path

    return user_cache_path("indenter") / "fingertip"


def key_of(pad: PadFile, load: str, more: Mapping[str, Any]) -> str:
    """Return the key of what a solution depends on: sizes (not their sources), mesh, library; hexadecimal."""
    settings = pad.model_dump(mode="json", exclude={"calibration"})
    settings["geometry"] = {name: size["value"] for name, size in settings["geometry"].items()}
    for name in ("file", "line_file", "plate_file"):
        del settings["mesh"][name]
    file = pad.mesh.file_for(load)
    if file is not None:
        # the parametric shape has no say then
        del settings["geometry"]
        try:
            settings["mesh"]["file"] = hashlib.sha256(file.read_bytes()).hexdigest()
        except OSError as error:
            raise BadInputError(f"{file}: can't be read: {error.strerror}") from error
    for tool in {"punch", "plate"} - {load}:
        del settings[tool]
    if load == "plate":
        settings["plate"] = pad.plate.length_mm.value
    whole = {"layout": _LAYOUT, "ngsolve": version("ngsolve"), "load": load, "pad": settings, **more}
    return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()[:24]


def recall(
    folder: Path, key: str, solve: Callable[[], Mapping[str, np.ndarray[Any, Any]]]
) -> Mapping[str, np.ndarray[Any, Any]]:
    """Return the arrays stored under a key, or solve for them and store them.

    A damaged file is solved for again. Raises BadInputError where the folder can't be written.
    """
    path = folder / f"{key}.npz"
    stored = _load(path)
    if stored is not None:
        return stored
    arrays = dict(solve())
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # whole or not at all: another process may be reading, or this one be stopped
        with tempfile.NamedTemporaryFile(dir=folder, suffix=".part", delete=False) as part:
            np.savez(part, allow_pickle=False, **arrays)
        Path(part.name).replace(path)
    except OSError as error:
        raise BadInputError(
            f"{folder}: can't be written ({error.strerror}): choose another --cache"
        ) from error
    return arrays


def _load(path: Path) -> Mapping[str, np.ndarray[Any, Any]] | None:
    import zipfile

    try:
        with np.load(path, allow_pickle=False) as stored:
            return {name: stored[name] for name in stored.files}
    except (FileNotFoundError, zipfile.BadZipFile, ValueError, EOFError, KeyError):
        return None
