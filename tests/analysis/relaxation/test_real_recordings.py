"""Real recordings: imported and fitted with what is wrong said, or refused with the reason."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from analysis.recordings.importing import import_recordings
from analysis.relaxation.batch import fit_paths

RECORDINGS = Path(__file__).parents[3].parent / "shared" / "recordings"
pytestmark = pytest.mark.skipif(
    not RECORDINGS.is_dir(), reason="the real recordings are not beside the project"
)


def fitted(out: Path, files: list[Path], model: str = "ramp") -> dict[str, dict[str, str]]:
    imported, refused = import_recordings(files, out / "trials")
    assert not refused
    fit_paths([one.path for one in imported], model=model, out=out, jobs=1)  # type: ignore[arg-type]
    with (out / "fits.csv").open(newline="", encoding="utf-8") as file:
        return {row["file"]: row for row in csv.DictReader(file)}


@pytest.mark.parametrize("model", ["ramp", "step"])
def test_dual_mode_lever_recordings(tmp_path: Path, model: str):
    files = sorted((RECORDINGS / "aurora_ddf").glob("relaxation_*.ddf"))
    files += sorted((RECORDINGS / "aurora_ddf").glob("creep_*.ddf"))
    rows = fitted(tmp_path, files, model)
    assert len(rows) == len(files)
    for name, row in rows.items():
        # holds of 0.12 to 0.25 s on an unstated specimen: nothing here passes without a word
        assert row["flags"], name
        if row["t1_s"] and row["t2_s"]:
            assert float(row["t1_s"]) > float(row["t2_s"]) > 0
            assert float(row["A1_over_A0"]) >= 0
            assert float(row["A2_over_A0"]) >= 0
    for name in ("creep_20mN.h5", "creep_400mN.h5"):
        assert "no phase named hold" in rows[name]["flags"]
    changed = rows["relaxation_90_2.h5"]["flags"]
    assert "control_mode_changed" in changed or "not fitted" in changed
    ringing = rows["relaxation_30_2.h5"]["flags"]
    assert "ringing" in ringing or "not fitted" in ringing


def test_cell_recording_is_flagged(tmp_path: Path):
    pytest.importorskip("afmformats")
    (row,) = fitted(tmp_path, sorted((RECORDINGS / "afm_relaxation").glob("*.jpk-force"))).values()
    assert "times_not_identifiable" in row["flags"] or "not fitted" in row["flags"]


def test_free_travel_and_twitch_have_no_hold(tmp_path: Path):
    files = [RECORDINGS / "emps_servo" / "emps_train.csv", RECORDINGS / "aurora_muscle_ddf" / "twitch.ddf"]
    for row in fitted(tmp_path, files).values():
        assert "no phase named hold" in row["flags"]


@pytest.mark.parametrize("name", ["bad_units", "invalid_exp", "non-numeric"])
def test_malformed_files_are_refused(tmp_path: Path, name: str):
    made, refused = import_recordings([RECORDINGS / "aurora_muscle_ddf" / f"{name}.ddf"], tmp_path)
    assert not made
    assert len(refused) == 1


def test_titin_ramps_fail_in_numbers(tmp_path: Path):
    """One ramp fitted, the others predicted: the tool flags what R2 of each fit hides."""
    files = []
    for seconds in ("0.1", "1", "10", "100"):
        source = RECORDINGS / "titin_ramps" / f"AvgRelaxed_{seconds}s.csv"
        target = tmp_path / f"titin_{seconds}s.csv"
        with source.open(newline="") as read, target.open("w", newline="") as write:
            writer = csv.writer(write)
            writer.writerow(["time_s", "position_mm", "force_mn"])
            writer.writerows(
                [float(row["Time"]) - 2.0, float(row["L"]) - 0.95, row["F"]] for row in csv.DictReader(read)
            )
        files.append(target)
    rows = fitted(tmp_path, files)
    document = json.loads((tmp_path / "fits.json").read_text())
    said = document["other_ramps"]
    assert len(said) == 12
    assert all(item["failed"] for item in said)
    assert max(abs(item["peak_share"]) for item in said) > 0.2
    assert all("other_ramp_missed=" in row["flags"] for row in rows.values())
    fits = [row for row in rows.values() if row["A0_mn"]]
    assert fits
    for row in fits:
        assert "residual_not_white=" in row["flags"]
        assert float(row["r2"]) > 0.9
    assert "One ramp predicts another" in (tmp_path / "fits.html").read_text()
