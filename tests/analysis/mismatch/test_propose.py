from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from analysis.mismatch.propose.planned import PlannedTrial, planned_cells
from analysis.mismatch.propose.separation import Separation
from rig.settings.reading import check_protocol_on_rig, parse_protocol, parse_rig


def test_next_protocol_runs_on_the_rig_and_shows_a_compliant_lever(plain: Any) -> None:
    proposed = plain.report["next_experiment"]
    text = (plain.out / proposed["protocol"]).read_text(encoding="utf-8")
    protocol = parse_protocol(text, "next.toml")
    check_protocol_on_rig(protocol, parse_rig("", "rig.toml"), "next.toml")
    assert protocol.kind == "study"
    assert protocol.study.rigid_target
    assert ["lever_compliance", "tissue"] in proposed["separates"]
    assert proposed["predicted_separation"]["lever_compliance | tissue"] > 10
    assert "rigid target" in proposed["reason"]
    assert [round(d, 2) for d in protocol.study.depths_mm] == [0.3, 0.7]
    assert len(protocol.study.depths_mm) * protocol.study.repeats >= 8


@pytest.mark.parametrize("kind", ["ramp_hold_retract", "rigid_target", "air_sweep"])
def test_planned_trials_have_their_phases(kind: str) -> None:
    plan = PlannedTrial(kind=kind, hold_s=1.0, dwell_s=0.5)  # type: ignore[arg-type]
    cells = planned_cells(plan, 8000.0)
    phases = ("sweep",) if kind == "air_sweep" else ("approach", "dwell", "ramp", "hold", "retract", "clear")
    for phase in phases:
        assert cells.in_phase(phase).any()
    assert np.all(np.diff(cells.time_s) > 0)
    assert np.all(cells.counts >= 1)
    if kind == "ramp_hold_retract":
        assert cells.depth_mm == pytest.approx(plan.depth_mm, abs=0.01)
        assert cells.z0_start_mm == pytest.approx(plan.z0_mm, abs=0.01)
        ramp = np.abs(cells.velocity_mm_s[cells.in_phase("ramp")])
        assert np.median(ramp) == pytest.approx(plan.ramp_speed_mm_s, rel=0.01)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e200])
def test_flips_of_any_difference_are_no_more_than_the_root_of_their_number(size: float) -> None:
    """A law that is far from where it was fitted may be beyond any square."""
    e = size * np.array([1.0, 2.0, 3.0, 4.0])
    of_flips = Separation(gg=e, Jg=np.zeros((4, 1)), JJ=np.zeros((4, 1, 1)), known=np.eye(1))
    expected = 10.0 / np.sqrt(30.0 + 10.0 / size)
    assert of_flips.flip_statistic == pytest.approx(expected, rel=1e-9)
