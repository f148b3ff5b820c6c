"""What the diagnosis says of a servo axis of another laboratory, whose masses and frictions are published."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from analysis.mismatch.diagnose import diagnose_paths
from analysis.recordings.importing import import_recordings

EMPS = Path(__file__).parents[4] / "shared" / "recordings" / "emps_servo" / "emps_train.csv"
PUBLISHED = {  # Janot, Gautier, Brunot 2019: 95.1 kg, 203.5 N s/m, 20.4 N
    "arm_inertia": 95.1e3,
    "viscous_friction": 203.5,
    "coulomb_friction": 20.4e3,
}


def test_a_published_servo_axis_is_recognised(tmp_path: Path) -> None:
    """A thousandfold of the lever's travel, mass and friction, in one recording without a rest."""
    if not EMPS.exists():
        pytest.skip("the real recordings (../shared/recordings) are not here")
    imported, refused = import_recordings([EMPS], tmp_path / "emps", "air_sweep")
    assert not refused
    page = diagnose_paths([one.path for one in imported], out=tmp_path / "page")
    report = json.loads((page.parent / "report.json").read_text(encoding="utf-8"))
    found = {
        m["name"]: next(iter(m["parameters"].values()))
        for m in report["mechanisms"]
        if m["stage"] == "sensor"
    }
    assert set(found) == set(PUBLISHED)
    for name, published in PUBLISHED.items():
        assert found[name]["value"] == pytest.approx(published, rel=0.02), name
        assert abs(found[name]["value"] - published) < 3.0 * found[name]["se"], name
