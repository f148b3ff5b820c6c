"""The whole loop once: confusable, next.toml, run, resolved, and a twin that behaves as the bench.

A bench with a lever that bends (0.5 um/mN): its linear tissue hides it completely. Every recording is made by
`indenter run`, through the card's own driver client.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.mismatch.diagnose import diagnose_paths
from analysis.recordings import find_trials, read_trial
from rig.headless import run_protocol_file

STUDY = """
kind = "study"
[study]
fingers = ["index"]
depths_mm = [0.3, 0.6]
repeats = 4
rest_s = 60.0
[surface]
start_mm = 2.5
samples_per_read = 40
[indentation]
hold_s = 3.0
dwell_s = 0.5
"""
RIG = """
name = "bent"
[card]
address = "companion:card"
loopback_channel = "ai2"
read_interval_s = 0.05
[stage]
port = "companion:stage"
[operator]
address = "companion:control"
[clock]
address = "companion:control"
[companion]
command = ["{python}", "-m", "sim_hardware"]
[companion.settings]
seed = 5
time = "virtual"
[companion.settings.specimens]
published_tissue = true
[companion.settings.constants]
spread = 0.0
zero_spread_v = 0.0
"""
BENT = """
[[companion.settings.effects]]
name = "lever_compliance"
compliance_um_per_mn = 0.5
"""


def report_of(trials: Path, out: Path) -> dict[str, Any]:
    page = diagnose_paths([trials], out=out)
    found: dict[str, Any] = json.loads((page.parent / "report.json").read_text(encoding="utf-8"))
    print(f"\n{out.name}: {found['verdict']}. {found['summary']}")
    return found


def hold_forces(trials: Path) -> dict[float, float]:
    """Mean force (mN) of the last second of the hold by depth, less the force clear of the skin."""
    found: dict[float, list[float]] = {}
    for path in find_trials([trials]):
        trial = read_trial(path)
        hold, clear = trial.phase("hold"), trial.phase("clear")
        if (
            trial.kind != "ramp_hold_retract"
            or hold is None
            or clear is None
            or trial.protocol.depth_mm is None
        ):
            continue
        level = float(np.mean(trial.force_mn[hold.stop - 8000 : hold.stop]))
        zero = float(np.mean(trial.force_mn[clear.start + 400 : clear.stop]))
        found.setdefault(round(trial.protocol.depth_mm, 3), []).append(level - zero)
    return {depth: float(np.mean(values)) for depth, values in found.items()}


@pytest.mark.slow
@pytest.mark.benchmark
def test_confusable_then_next_then_resolved_then_twin(tmp_path: Path) -> None:
    study, rig = tmp_path / "study.toml", tmp_path / "rig.toml"
    study.write_text(STUDY, encoding="utf-8")
    rig.write_text(RIG + BENT, encoding="utf-8")
    first = report_of(run_protocol_file(study, rig=rig, out=tmp_path / "first"), tmp_path / "first-diagnosis")
    assert "lever_compliance" in [h["name"] for h in first["not_identifiable"]]
    proposed = first["next_experiment"]
    print("proposed:", proposed["reason"])
    second_trials = run_protocol_file(
        tmp_path / "first-diagnosis" / proposed["protocol"], rig=rig, out=tmp_path / "second"
    )
    second = report_of(second_trials, tmp_path / "second-diagnosis")
    named = {m["name"]: m for m in second["mechanisms"]}
    print("named:", {n: m["parameters"] for n, m in named.items()})
    for which, report in (("first", first), ("second", second)):
        k0 = report["improved_parameters"]["k0_mn_per_mm"]
        print(f"k0 after the {which} study: {k0['value']:.2f} +- {k0['se']:.2f} mN/mm (true 120)")
    assert "lever_compliance" in named
    found = named["lever_compliance"]["parameters"]["compliance_um_per_mn"]
    assert found["value"] == pytest.approx(0.5, rel=0.1)
    assert second["improved_parameters"]["k0_mn_per_mm"]["value"] == pytest.approx(120.0, rel=0.02)

    twin = tmp_path / "second-diagnosis" / "twin.toml"
    of_twin = run_protocol_file(study, rig=twin, out=tmp_path / "twin")
    again = report_of(of_twin, tmp_path / "twin-diagnosis")
    bench, copy = hold_forces(tmp_path / "first"), hold_forces(of_twin)
    print("force at the end of the hold, bench and twin (mN):", {d: (bench[d], copy[d]) for d in bench})
    for name in ("noise_floor_mn", "baseline_rms_mn"):
        print(f"{name}: bench {first['heldout'][name]:.4f}, twin {again['heldout'][name]:.4f}")
    assert again["verdict"] == first["verdict"]
    assert again["heldout"]["noise_floor_mn"] == pytest.approx(first["heldout"]["noise_floor_mn"], rel=0.05)
    for name in ("k0_mn_per_mm", "k1_mn_per_mm", "k2_mn_per_mm", "tau1_s", "tau2_s"):
        one, other = (r["baseline_parameters"][name]["value"] for r in (first, again))
        assert one == pytest.approx(other, rel=0.02), name
