"""Constants that belong: to this rig, of their kind, of this time; a study never mixes them silently."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import datetime, timedelta
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from analysis.errors import BadInputError
from rig.calibration.kept import calibration_for, newest_calibration
from rig.calibration.mixing import check_same_rig, keep_rig
from rig.settings.rig_file import RigFile

RIG = RigFile(name="left bench")
NOW = datetime.now().astimezone()


def made(folder: Path, **changes: Any) -> Path:
    measured = {"se": 1e-5, "dof": 5}
    content = {
        "format": "indenter-calibration",
        "format_version": 1,
        "kind": "force",
        "rig": "left bench",
        "units": "V, V/mm, V/mN",
        "calibrated": (NOW - timedelta(days=1)).isoformat(),
        "valid_until": (NOW + timedelta(days=29)).isoformat(),
        "constants": {
            "volts_per_mn": {"value": 0.0151} | measured,
            "force_zero_v": {"value": 0.01} | measured,
        },
    }
    folder.mkdir(exist_ok=True)
    path = folder / "force.json"
    path.write_text(json.dumps(content | changes))
    return path


def constants(slope: float, zero_v: float = 0.0) -> dict[str, Any]:
    measured = {"se": 1e-5, "dof": 5}
    return {"volts_per_mn": {"value": slope} | measured, "force_zero_v": {"value": zero_v} | measured}


def test_a_calibration_of_this_rig_is_taken(tmp_path: Path) -> None:
    made(tmp_path)
    assert newest_calibration(RIG, tmp_path)[0].volts_per_mn == 0.0151


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rig": "right bench"}, "belongs to the rig 'right bench'"),
        ({"units": "mV"}, "its units are 'mV'"),
        ({"kind": "position"}, "a position calibration has volts_per_mm"),
        ({"constants": constants(-0.0151)}, "volts_per_mn = -0.0151 is not within 20%"),
        ({"constants": constants(0.15)}, "volts_per_mn = 0.15 is not within 20%"),
        ({"constants": constants(0.0151, 2.0)}, "force_zero_v = 2 is not within 1 V"),
        ({"calibrated": (NOW + timedelta(days=2)).isoformat()}, "which is yet to come"),
        ({"calibrated": "2026-01-01T10:00:00"}, "says no time zone"),
    ],
)
def test_one_that_is_not_is_refused(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    made(tmp_path, **changes)
    with pytest.raises(BadInputError, match=words) as caught:
        newest_calibration(RIG, tmp_path)
    assert "\n" not in str(caught.value)


def test_one_whose_time_is_over_is_asked_for(tmp_path: Path) -> None:
    made(tmp_path / "calibrations", valid_until=(NOW - timedelta(hours=1)).isoformat())
    console = Console(file=StringIO())
    asked: list[str] = []

    def answer(yes: bool) -> Any:
        return lambda question: asked.append(question) or yes

    with pytest.raises(BadInputError, match=r"force: the calibration of .* expired on"):
        calibration_for(RIG, tmp_path / "rig.toml", console, answer(False))
    assert calibration_for(RIG, tmp_path / "rig.toml", console, answer(True)).volts_per_mn == 0.0151
    assert len(asked) == 2


def test_a_study_goes_on_with_its_own_rig_and_constants(tmp_path: Path) -> None:
    nominal = RIG.calibration.nominal()
    check_same_rig(RIG, nominal, tmp_path, lambda _: False)
    keep_rig(RIG, nominal, tmp_path)
    check_same_rig(RIG, nominal, tmp_path, lambda _: False)
    other = replace(nominal, volts_per_mn=0.0155)
    with pytest.raises(BadInputError, match=r"another calibration \(volts_per_mn changed\)"):
        check_same_rig(RIG, other, tmp_path, lambda _: False)
    check_same_rig(RIG, other, tmp_path, lambda _: True)
    with pytest.raises(BadInputError, match="recorded on the rig 'left bench', and this is 'right bench'"):
        check_same_rig(RigFile(name="right bench"), nominal, tmp_path, lambda _: True)
