"""The whole loop once: confusable, next.toml, run, resolved, and a twin that behaves as the bench.

A bench with a lever that bends (0.5 um/mN): its linear tissue hides it completely. Every recording is made by
`indenter run`, through the card's own driver client.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from analysis.mismatch.diagnose import diagnose_paths
from rig.commands.run import run_protocol_file

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
TISSUE = ("k0_mn_per_mm", "k1_mn_per_mm", "tau1_s", "k2_mn_per_mm", "tau2_s")


def report_of(trials: Path, out: Path) -> dict[str, Any]:
    page = diagnose_paths([trials], out=out)
    found: dict[str, Any] = json.loads((page.parent / "report.json").read_text(encoding="utf-8"))
    print(f"\n{out.name}: {found['verdict']}. {found['summary']}")
    return found


@pytest.mark.slow
@pytest.mark.benchmark
def test_confusable_then_next_then_resolved_then_twin(tmp_path: Path) -> None:
    study, rig = tmp_path / "study.toml", tmp_path / "rig.toml"
    study.write_text(STUDY, encoding="utf-8")
    rig.write_text(RIG + BENT, encoding="utf-8")
    first = report_of(run_protocol_file(study, rig=rig, out=tmp_path / "first"), tmp_path / "first-diagnosis")
    hidden = {h["name"]: h for h in first["not_identifiable"]}
    for name, h in hidden.items():
        print(f"  may hide: {name}: {h['reason']}; separated by {h['separated_by']}")
    assert first["verdict"] == "no_mismatch"
    assert "lever_compliance" in hidden
    proposed = first["next_experiment"]
    print("proposed:", proposed["reason"])
    protocol = tmp_path / "first-diagnosis" / proposed["protocol"]
    print(protocol.read_text(encoding="utf-8"))

    of_next = run_protocol_file(protocol, rig=rig, out=tmp_path / "second")
    second = report_of(of_next, tmp_path / "second-diagnosis")
    named = {m["name"]: m for m in second["mechanisms"]}
    assert "lever_compliance" in named
    found = named["lever_compliance"]["parameters"]["compliance_um_per_mn"]
    print(
        f"separation: predicted {proposed['predicted_separation']['lever_compliance | tissue']:.0f} standard "
        f"deviations, found {found['value']:.3f} +- {found['se']:.3f} um/mN (true 0.5), "
        f"{found['value'] / found['se']:.0f} of its errors from none; p = {named['lever_compliance']['p_value']:.2g}"
    )
    for which, report in (("first", first), ("second", second)):
        k0 = report["improved_parameters"]["k0_mn_per_mm"]
        print(f"k0 after the {which} study: {k0['value']:.2f} +- {k0['se']:.2f} mN/mm (true 120)")
    assert second["verdict"] == "named"
    assert abs(found["value"] - 0.5) < 3.0 * found["se"] < 0.25
    assert second["improved_parameters"]["k0_mn_per_mm"]["value"] == pytest.approx(120.0, rel=0.02)

    of_twin = run_protocol_file(study, rig=tmp_path / "second-diagnosis" / "twin.toml", out=tmp_path / "twin")
    again = report_of(of_twin, tmp_path / "twin-diagnosis")
    # on a block the noise of the position is a force too: each study has its own noise
    noise_mn = {"bench": second["heldout"]["noise_floor_mn"], "twin": first["heldout"]["noise_floor_mn"]}
    left = {name: r["heldout"]["improved_rms_mn"] for name, r in (("bench", second), ("twin", again))}
    print(f"the simulation leaves {left} mN rms of the bench and of its twin; noise {noise_mn}")
    for name in TISSUE:
        one, other = (r["baseline_parameters"][name] for r in (first, again))
        print(f"  {name} fitted to the same study: bench {one['value']:.4g}, twin {other['value']:.4g}")
        assert one["value"] == pytest.approx(other["value"], rel=0.02), name
    assert again["verdict"] == first["verdict"]
    assert left == pytest.approx(noise_mn, rel=0.02)
    # a study's own floor follows what it leaves: nor may that be much above the noise of skin alone
    assert left["bench"] < 1.04 * noise_mn["twin"]
