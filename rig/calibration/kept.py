"""Calibrations on disk: each routine writes one file, a run takes the newest of each kind."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError
from rich.console import Console

from analysis.errors import BadInputError
from analysis.recordings.trial import Calibration
from rig.calibration.lines import Constant, Line, student_95
from rig.settings.rig_file import RigFile

Which = Literal["position", "force"]
FOLDER = "calibrations"


class _Measured(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", strict=True, allow_inf_nan=False)
    value: float
    se: float
    dof: int


class CalibrationFile(BaseModel):
    """What a run needs of a calibration file; the file says more, for people."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True, allow_inf_nan=False)
    format: Literal["indenter-calibration"]
    format_version: Literal[1]
    kind: Which
    calibrated: str
    valid_until: str
    constants: Mapping[str, _Measured]


def calibration_folder(rig: RigFile, rig_path: Path | None) -> Path | None:
    """Return where a rig's calibrations are: as its file says, else beside the file; None without a file."""
    if rig_path is None:
        return Path(rig.calibration.folder) if rig.calibration.folder else None
    return rig_path.parent / (rig.calibration.folder or FOLDER)


def calibration_for(rig: RigFile, rig_path: Path | None, console: Console) -> Calibration:
    """Return the constants to run with, and say on the console where they come from."""
    folder = calibration_folder(rig, rig_path)
    calibration, used = newest_calibration(rig, folder)
    for kind in ("position", "force"):
        found = used.get(kind)
        if found is None:
            console.print(
                f"{kind}: nominal constants of the rig file; `indenter calibrate {kind}` measures them",
                highlight=False,
                soft_wrap=True,
            )
        elif datetime.fromisoformat(found.valid_until) < datetime.now().astimezone():
            console.print(
                f"{kind}: the calibration of {found.calibrated[:10]} expired on {found.valid_until[:10]}: "
                f"run `indenter calibrate {kind}` again",
                highlight=False,
                soft_wrap=True,
            )
    return calibration


def newest_calibration(
    rig: RigFile, folder: Path | None
) -> tuple[Calibration, Mapping[str, CalibrationFile]]:
    """Return the nominal constants with the newest measured ones in their place, and the files used.

    Raises BadInputError where a file in the folder is no calibration.
    """
    calibration = rig.calibration.nominal()
    used: dict[str, CalibrationFile] = {}
    files = [load_calibration(path) for path in sorted(folder.glob("*.json"))] if folder else []
    for found in sorted(files, key=lambda file: file.calibrated):
        used[found.kind] = found
    for found in used.values():
        calibration = with_constants(calibration, found.constants, found.calibrated)
    return calibration, used


def with_constants(
    calibration: Calibration, constants: Mapping[str, Constant | _Measured], calibrated: str
) -> Calibration:
    """Return the calibration with measured constants, and their standard errors, in place of its own."""
    errors = {name: constant.se for name, constant in constants.items() if constant.se > 0}
    values: dict[str, Any] = {name: constant.value for name, constant in constants.items()}
    return replace(
        calibration,
        **values,
        calibrated=max(calibration.calibrated, calibrated),
        standard_errors={**calibration.standard_errors, **errors},
    )


def load_calibration(path: Path) -> CalibrationFile:
    """Read one calibration file. Raises BadInputError, in one line, where it is none."""
    try:
        return CalibrationFile.model_validate_json(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise BadInputError(f"{path}: can't be read ({error}): remove it, or calibrate again") from error
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "the file"
        raise BadInputError(
            f"{path}: no calibration ({where}: {first['msg']}): remove it, or calibrate again"
        ) from error


def save_calibration(
    folder: Path,
    which: Which,
    constants: Mapping[str, Constant],
    line: Line,
    *,
    valid_days: float,
    about: Mapping[str, Any],
) -> Path:
    """Write a calibration file with its points and residuals; return its path."""
    now = datetime.now().astimezone()
    content = {
        "format": "indenter-calibration",
        "format_version": 1,
        "kind": which,
        "calibrated": now.isoformat(),
        "valid_until": (now + timedelta(days=valid_days)).isoformat(),
        "constants": {
            name: {
                "value": constant.value,
                "se": constant.se,
                "dof": constant.dof,
                "half_width_95": student_95(constant.dof) * constant.se,
            }
            for name, constant in constants.items()
        },
        "line": {
            "x": line.x.tolist(),
            "y_v": line.y.tolist(),
            "residuals_v": line.residuals.tolist(),
            "r2": line.r2,
        },
        **about,
    }
    path = folder / f"{which}-{now:%Y%m%dT%H%M%S%f}.json"
    folder.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    return path
