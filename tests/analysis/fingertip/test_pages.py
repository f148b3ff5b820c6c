from __future__ import annotations

import meshio
import numpy as np
import pytest

from analysis.fingertip.calibration_file import read_calibration
from rig.cli import main


@pytest.fixture(scope="module")
def folder(tmp_path_factory, coarse_pad, measured, punch, cache, pad_text, fits_of):
    """A folder that `indenter fingertip calibrate` wrote; the pad under the punch is in the cache already."""
    folder = tmp_path_factory.mktemp("calibrated")
    (folder / "pad.toml").write_text(pad_text(coarse_pad))
    fits_of(folder, measured)
    calls = [
        "calibrate",
        folder / "fits.json",
        "--pad",
        folder / "pad.toml",
        "--out",
        folder,
        "--cache",
        cache,
    ]
    with pytest.MonkeyPatch.context() as patched:
        # found again by what went into it
        patched.setattr("analysis.fingertip.punch.full_punch_pad", lambda _: pytest.fail("solved again"))
        assert main(["fingertip", *map(str, calls)]) == 0
    return folder


def test_calibrate_writes_table_page_rigs_and_vtu(folder, coarse_pad):
    found = read_calibration(folder)
    assert found.pad == coarse_pad
    assert [pad.kind for pad in found.pads] == ["homogeneous", "layered"]
    assert found.pads[0].force.relaxed_mn_per_mm == pytest.approx(120, rel=1e-6)
    page = (folder / "calibration.html").read_text()
    assert "Force alone can&#39;t choose" in page or "Force alone can't choose" in page
    assert page.count("data:image/png;base64,") == 3
    pressed = meshio.read(folder / "layered_pressed.vtu")
    moved = pressed.point_data["displacement_mm"]
    # the punch goes down by the depth; just under its rim skin moves a hair further
    assert -0.41 < moved[:, 1].min() <= -0.4 + 1e-9


def test_a_damaged_solution_is_solved_for_again(coarse_pad, punch, cache, tmp_path):
    from analysis.fingertip.cache import recall

    (tmp_path / "key.npz").write_bytes(b"half a file")
    found = recall(tmp_path, "key", lambda: {"a": np.arange(3)})
    again = recall(tmp_path, "key", lambda: pytest.fail("was stored"))
    assert found["a"].tolist() == again["a"].tolist() == [0, 1, 2]


def test_what_goes_into_a_solution_is_in_its_key(coarse_pad):
    from analysis.fingertip.cache import key_of

    key = key_of(coarse_pad, "punch", {})
    assert key == key_of(coarse_pad, "punch", {})
    thicker = coarse_pad.with_epidermis(0.31)
    slide = {"punch": coarse_pad.punch.model_copy(update={"contact": "frictionless"})}
    for other in (thicker, coarse_pad.model_copy(update=slide)):
        assert key_of(other, "punch", {}) != key
    # neither sources nor the punch matter where they can't
    assert key_of(coarse_pad.model_copy(update=slide), "line", {}) == key_of(coarse_pad, "line", {})


def test_receptor_writes_its_page(folder, coarse_pad, cache, capsys):
    (folder / "rates.csv").write_text(
        "time_s,rate_hz\n" + "".join(f"{0.1 * i},{90 - 3 * i}\n" for i in range(1, 24))
    )
    arguments = ["fingertip", "receptor", "--out", str(folder), "--cache", str(cache)]
    assert main([*arguments, "--rates", str(folder / "rates.csv")]) == 0
    page = (folder / "receptor.html").read_text()
    assert "rates.csv" in page
    assert page.count("data:image/png;base64,") == 3
    assert main(arguments) == 0
    assert "not in print as numbers" in (folder / "receptor.html").read_text()
    capsys.readouterr()
    assert main([*arguments, "--shallowest", "0.9", "--deepest", "0.5"]) == 2
    assert "give them rising" in capsys.readouterr().err


def test_compare_needs_a_calibration(tmp_path, capsys):
    (tmp_path / "s.csv").write_text(
        "position_mm,deflection_mm\n" + "".join(f"{i / 4},{0.4 - i / 40}\n" for i in range(9))
    )
    assert main(["fingertip", "compare", str(tmp_path / "s.csv"), "--out", str(tmp_path)]) == 2
    assert "run `indenter fingertip calibrate" in capsys.readouterr().err
