"""One clear line for every bad input, and exit code 2."""

from __future__ import annotations

import json
import re

import pytest

from analysis.fingertip.pad_file import example_text
from rig.cli import main


def _fits(folder, **changes):
    row = {
        "file": "a.h5", "finger": "index", "failure": "", "discarded": "", "model": "ramp", "depth_mm": 0.4,
        "ramp_s": 0.08, "hold_s": 7.0, "estimates": {},
        "solid": {"stiffness_mn_per_mm": [120.0, 44.0, 35.0], "times_s": [2.3, 0.15],
                  "covariance": [[1e-4 * (i == j) for j in range(7)] for i in range(7)]},
    }  # fmt: skip
    path = folder / "fits.json"
    path.write_text(json.dumps({"format": "indenter-fits", "trials": [row | changes]}))
    return path


def _refused(capsys, arguments):
    assert main(["fingertip", *map(str, arguments)]) == 2
    errors = capsys.readouterr().err
    assert errors.count("\n") == 1
    assert "Traceback" not in errors
    return errors


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (r"epidermis_mm += \{ value = 0.3", "epidermis_mm = { value = -0.3", "epidermis_mm.value = -0.3: .* greater"),
        (r"bone_half_width_mm += \{ value = 1.6", "bone_half_width_mm = { value = 3.1", "leaves the fat sideways"),
        (r"bone_dorsal_shift_mm += \{ value = 0.9", "bone_dorsal_shift_mm = { value = 1.6", "fat on the nail"),
        (r"\[layers.fat\]\nnu = 0.48", "[layers.fat]\nnu = 0.5", r"layers.fat.nu = 0.5: .* less than 0.5"),
        (r"half_height_mm += .*", "half_height_mm = 3.5", r"half_height_mm = 3.5: write it as \{ value"),
        (r"tip_length_mm += .*", "", "geometry.tip_length_mm is missing"),
        (r"order += 3", "ordre = 3", "unknown key 'mesh.ordre'"),
        (r"order += 3", "order = [", "not valid TOML"),
        (r"order += 3", "order = 1", "mesh.order = 1: .* greater than or equal to 2"),
        (r'# line_file = "line.msh"', 'line_file = "line.msh"', "mesh: line_file or plate_file without file"),
        (r"contact_z_mm += \{ value = -1.0", "contact_z_mm = { value = 1.0", "must lie on the tube"),
        (r'# file = "pad.msh"', 'file = "nowhere.msh"', "nowhere.msh: can't be read"),
    ],
)  # fmt: skip
def test_a_wrong_pad_file(tmp_path, capsys, old, new, said):
    text, count = re.subn(old, new, example_text(), count=1)
    assert count == 1
    (tmp_path / "pad.toml").write_text(text)
    errors = _refused(
        capsys,
        ["calibrate", _fits(tmp_path), "--pad", tmp_path / "pad.toml", "--out", tmp_path / "out",
         "--cache", tmp_path / "cache"],
    )  # fmt: skip
    assert re.search(said, errors), errors


def test_wrong_fits(tmp_path, capsys):
    out = ["--out", tmp_path / "out", "--cache", tmp_path / "cache"]
    assert "can't be read" in _refused(capsys, ["calibrate", tmp_path / "no.json", *out])
    (tmp_path / "other.json").write_text("{}")
    assert "not a fits.json" in _refused(capsys, ["calibrate", tmp_path / "other.json", *out])
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    assert "column 'A0_mn' is missing" in _refused(capsys, ["calibrate", tmp_path / "other.csv", *out])
    fits = _fits(tmp_path)
    assert "there are index" in _refused(capsys, ["calibrate", fits, "--finger", "ring", *out])
    assert "holds no fitted trial" in _refused(
        capsys, ["calibrate", _fits(tmp_path, failure="no skin"), *out]
    )


def test_the_example_is_not_written_over(tmp_path, capsys):
    assert main(["fingertip", "example", str(tmp_path)]) == 0
    capsys.readouterr()
    assert "is there already" in _refused(capsys, ["example", tmp_path])
