"""Calibrations on disk: each routine writes one file, a run takes the newest of each kind."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError, field_validator
from rich.console import Console

from analysis.errors import BadInputError
from analysis.recordings.trial import Calibration
from rig.calibration.lines import Constant, Line, student_95
from rig.settings.constants import constants_problem, difference_problem
from rig.settings.rig_file import RigFile

Which = Literal["position", "force"]
FOLDER = "calibrations"
_UNITS = "V, V/mm, V/mN"


class _Measured(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", strict=True, allow_inf_nan=False)
    value: float
    se: float
    dof: int


_CONSTANTS: Mapping[str, tuple[str, ...]] = {
    "position": ("volts_per_mm", "command_volts_per_mm", "position_zero_v", "command_zero_v"),
    "force": ("volts_per_mn", "force_zero_v"),
}

_CLOCK_SLACK = timedelta(hours=1)


class CalibrationFile(BaseModel):
    """What a run needs of a calibration file; the file says more, for people."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True, allow_inf_nan=False)
    format: Literal["indenter-calibration"]
    format_version: Literal[1]
    kind: Which
    calibrated: str
    valid_until: str
    constants: Mapping[str, _Measured]
    rig: str | None = None
    units: str | None = None

    @field_validator("calibrated", "valid_until")
    @classmethod
    def _is_a_moment(cls, text: str) -> str:
        if datetime.fromisoformat(text).tzinfo is None:
            raise ValueError("says no time zone")
        return text

    @property
    def made(self) -> datetime:
        """When it was made."""
        return datetime.fromisoformat(self.calibrated)

    @property
    def expired(self) -> bool:
        """Whether its time is over."""
        return datetime.fromisoformat(self.valid_until) < datetime.now().astimezone()


def calibration_folder(rig: RigFile, rig_path: Path | None) -> Path | None:
    """Return where a rig's calibrations are: as its file says, else beside the file; None without a file."""
    if rig_path is None:
        return Path(rig.calibration.folder) if rig.calibration.folder else None
    return rig_path.parent / (rig.calibration.folder or FOLDER)


def calibration_for(
    rig: RigFile, rig_path: Path | None, console: Console, ask: Callable[[str], bool] = lambda _: True
) -> Calibration:
    """Return the constants to run with, and say on the console where they come from.

    ``ask`` is asked whether to go on with a calibration whose time is over; BadInputError where it says no.
    """
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
        elif found.expired:
            words = (
                f"{kind}: the calibration of {found.calibrated[:10]} expired on {found.valid_until[:10]}: "
                f"run `indenter calibrate {kind}` again"
            )
            console.print(words, highlight=False, soft_wrap=True, markup=False)
            if not ask("go on with it all the same?"):
                raise BadInputError(words)
    return calibration


def newest_calibration(
    rig: RigFile, folder: Path | None
) -> tuple[Calibration, Mapping[str, CalibrationFile]]:
    """Return the nominal constants with the newest measured ones in their place, and the files used.

    Raises BadInputError where a file in the folder is no calibration.
    """
    calibration = rig.calibration.nominal()
    used: dict[str, CalibrationFile] = {}
    files = [_of_this_rig(path, rig) for path in sorted(folder.glob("*.json"))] if folder else []
    for found in sorted(files, key=lambda file: file.made):
        used[found.kind] = found
    for found in used.values():
        calibration = with_constants(calibration, found.constants, found.calibrated)
    problem = difference_problem(calibration, rig.calibration.nominal()) or constants_problem(
        calibration, rig.lever
    )
    if problem is not None:
        raise BadInputError(
            f"{folder}: the newest calibration is none of this rig's: {problem}: remove its file, or calibrate again"
        )
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


def _of_this_rig(path: Path, rig: RigFile) -> CalibrationFile:
    """Read a calibration file that must be this rig's, of its kind and no time to come; BadInputError else."""
    found = load_calibration(path)
    wrong = None
    if found.rig is not None and found.rig != rig.name:
        wrong = f"it belongs to the rig {found.rig!r}, and this is {rig.name!r}"
    elif found.units is not None and found.units != _UNITS:
        wrong = f"its units are {found.units!r}, not {_UNITS!r}"
    elif set(found.constants) != set(_CONSTANTS[found.kind]):
        wrong = f"a {found.kind} calibration has {', '.join(_CONSTANTS[found.kind])}"
    elif found.made > datetime.now().astimezone() + _CLOCK_SLACK:
        wrong = f"it was made on {found.calibrated[:10]}, which is yet to come: set the computer's clock"
    if wrong is not None:
        raise BadInputError(f"{path}: {wrong}: remove it, or calibrate again")
    return found


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
    rig: str,
    valid_days: float,
    about: Mapping[str, Any],
) -> Path:
    """Write a calibration file with its points and residuals; return its path."""
    now = datetime.now().astimezone()
    content = {
        "format": "indenter-calibration",
        "format_version": 1,
        "kind": which,
        "rig": rig,
        "units": _UNITS,
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
