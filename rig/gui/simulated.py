"""Simulated rigs as the window opens them: in real time, whatever their file says, since a person looks on."""

from __future__ import annotations

import hashlib
from importlib.resources import files
from pathlib import Path
from typing import Any

import platformdirs
import tomlkit
from tomlkit.exceptions import ParseError

from rig.calibration.kept import FOLDER

_EXAMPLE = "simulated_rig.toml"
_READ_S = 0.01
"""Samples fetched at a time: how soon a limit is noticed, and a stop."""


def rig_for_the_window(rig: Path | None, folder: Path | None = None) -> Path:
    """Return the rig file to open: ``rig``, or a copy of it in real time where its bench's time is virtual.

    Without ``rig``, the simulated rig that ships with the program. A copy lies in ``folder``, by default the
    user's data folder, and keeps its calibrations where the file itself has them. A file that can't be read
    is returned as it is: who opens it says what is wrong.
    """
    folder = folder or platformdirs.user_data_path("indenter") / "simulated"
    try:
        text = (files("rig.examples") / _EXAMPLE if rig is None else rig).read_text(encoding="utf-8")
        document: Any = tomlkit.parse(text)
        settings = document["companion"]["settings"]
        virtual = settings.get("time", "real") == "virtual"
    except (OSError, UnicodeDecodeError, ParseError, KeyError, TypeError, AttributeError):
        return rig or folder / "rig.toml"
    if rig is not None and not virtual:
        return rig
    settings["time"] = "real"
    document["card"]["read_interval_s"] = _READ_S
    if rig is None:
        path = folder / "rig.toml"
    else:
        kept = document.setdefault("calibration", tomlkit.table())
        kept["folder"] = str(rig.absolute().parent / kept.get("folder", FOLDER))
        path = folder / f"{rig.stem}-{hashlib.sha256(str(rig.absolute()).encode()).hexdigest()[:8]}.toml"
    folder.mkdir(parents=True, exist_ok=True)
    path.write_text(tomlkit.dumps(document), encoding="utf-8")
    return path
