"""What the diagnosis says of a servo axis of another laboratory, whose masses and frictions are published."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from analysis.mismatch.diagnose import diagnose_paths
from analysis.recordings.importing import import_recordings

EMPS = Path(__file__).parents[4] / "shared" / "recordings" / "emps_servo" / "emps_train.csv"
PUBLISHED = {  # Janot, Gautier, Brunot 2019: 95.1 kg, 203.5 N s/m, 20.4 N
    "arm_inertia": 95.1e3,
    "viscous_friction": 203.5,
    "coulomb_friction": 20.4e3,
}


@pytest.fixture(scope="module")
def emps(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The report on the axis: a thousandfold of the lever's travel, mass and friction, one recording without a rest."""
    if not EMPS.exists():
        pytest.skip("the real recordings (../shared/recordings) are not here")
    folder = tmp_path_factory.mktemp("emps")
    imported, refused = import_recordings([EMPS], folder / "trials", "air_sweep")
    assert not refused
    page = diagnose_paths([one.path for one in imported], out=folder / "page")
    return dict(json.loads((page.parent / "report.json").read_text(encoding="utf-8")))


def test_a_published_servo_axis_is_recognised(emps: dict[str, Any]) -> None:
    found = {
        m["name"]: next(iter(m["parameters"].values())) for m in emps["mechanisms"] if m["stage"] == "sensor"
    }
    assert set(found) == set(PUBLISHED)
    for name, published in PUBLISHED.items():
        assert found[name]["value"] == pytest.approx(published, rel=0.02), name
        assert abs(found[name]["value"] - published) < 3.0 * found[name]["se"], name


def test_its_lag_behind_the_command_is_named_in_the_position_channel(emps: dict[str, Any]) -> None:
    """Of the recording itself: position - command is -6.55 ms of velocity, by least squares on the whole of it."""
    (servo,) = [m for m in emps["mechanisms"] if m["name"] == "servo_bandwidth"]
    wn, zeta = (servo["parameters"][name]["value"] for name in ("natural_frequency_rad_s", "damping_ratio"))
    assert 2.0 * zeta / wn == pytest.approx(6.55e-3, rel=0.02)
    assert emps["verdict"] == "named"
    assert emps["explained_share"] > 0.95
