"""A study never mixes rigs or calibrations silently: its folder says with what it was begun."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from analysis.errors import BadInputError
from analysis.recordings.trial import Calibration
from rig.settings.rig_file import RigFile

RIG_FILE = "rig.json"


def keep_rig(rig: RigFile, calibration: Calibration, out: Path) -> None:
    """Write into the folder of a study on which rig, and with which constants, it goes on."""
    try:
        (out / RIG_FILE).write_text(json.dumps(_said(rig, calibration), indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise BadInputError(f"{out}: can't be written ({error.strerror}): give another --out") from error


def check_same_rig(rig: RigFile, calibration: Calibration, out: Path, ask: Callable[[str], bool]) -> None:
    """Refuse (BadInputError) to go on with a study on another rig; with another calibration, ask first."""
    path = out / RIG_FILE
    if not path.exists():
        return
    try:
        before: Any = json.loads(path.read_text(encoding="utf-8"))
        name, constants = str(before["rig"]), dict(before["constants"])
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise BadInputError(
            f"{path}: does not say with which rig the study was begun: give another --out"
        ) from error
    if name != rig.name:
        raise BadInputError(
            f"{out}: its trials were recorded on the rig {name!r}, and this is {rig.name!r}: give another --out"
        )
    now = _said(rig, calibration)["constants"]
    changed = [key for key, value in now.items() if constants.get(key) != value]
    if changed:
        words = f"{out}: its trials were recorded with another calibration ({', '.join(changed)} changed)"
        if not ask(f"{words}; go on with this one?"):
            raise BadInputError(f"{words}: give another --out, or --accept to go on with this one")


def _said(rig: RigFile, calibration: Calibration) -> dict[str, Any]:
    constants = {key: value for key, value in asdict(calibration).items() if isinstance(value, float)}
    return {"rig": rig.name, "device": rig.card.device, "constants": constants}
