"""Trials recorded straight from a world."""

from __future__ import annotations

import numpy as np
import pytest

from sim_hardware.concealment.offline import TrialPlan, record_study, rigid_plan, study_plans
from sim_hardware.settings import BenchSettings

QUIET = BenchSettings.from_toml("seed = 4\n[specimens]\npublished_tissue = true")


def test_surface_is_detected_as_deep_as_the_published_threshold_presses() -> None:
    """10 mN on 120 to 200 mN/mm is 0.05 to 0.08 mm; the host's latency adds 4 to 12 um."""
    for trial in record_study(QUIET, study_plans(repeats=2, hold_s=0.2)):
        assert trial.surface is not None
        into_mm = trial.surface.position_mm - float(str(trial.truth["surface_mm"]))
        assert 0.045 < into_mm < 0.08
        assert 3 < trial.surface.overshoot_um < 13


def test_phases_cover_the_trial_in_order() -> None:
    (trial,) = record_study(QUIET, [TrialPlan(hold_s=0.5, dwell_s=0.3)])
    assert [p[0] for p in trial.phases] == ["approach", "dwell", "ramp", "hold", "retract", "clear"]
    assert trial.phases[0][1] == 0
    assert trial.phases[-1][2] == len(trial.force_v) == len(trial.position_v) == len(trial.command_v)
    for before, after in zip(trial.phases, trial.phases[1:], strict=False):
        assert before[2] == after[1]


def test_depth_counts_from_the_detected_surface() -> None:
    (trial,) = record_study(QUIET, [TrialPlan(depth_mm=0.4, hold_s=0.5)])
    c = trial.calibration
    name, start, stop = trial.phases[3]
    assert name == "hold"
    position_mm = (trial.position_v[start + 100 : stop].mean() - c.position_zero_v) / c.volts_per_mm
    assert trial.surface is not None
    assert position_mm - trial.surface.position_mm == pytest.approx(0.4, abs=1e-4)


def test_sweep_and_block() -> None:
    sweep, block = record_study(QUIET, [TrialPlan(kind="air_sweep"), rigid_plan()])
    assert [p[0] for p in sweep.phases] == ["sweep"]
    assert sweep.surface is None
    c = block.calibration
    force_mn = (block.force_v - c.force_zero_v) / c.volts_per_mn
    assert 200 < force_mn.max() < 500
    assert block.target_mn_per_mm == 2.0e4
    sweep_mn = (sweep.force_v - c.force_zero_v) / c.volts_per_mn
    assert np.std(sweep_mn) == pytest.approx(0.3, rel=0.1)


def test_the_same_settings_give_the_same_study() -> None:
    first, again = (record_study(QUIET, study_plans(repeats=1, hold_s=0.2)) for _ in range(2))
    for a, b in zip(first, again, strict=True):
        assert np.array_equal(a.force_v, b.force_v)
        assert np.array_equal(a.position_v, b.position_v)


def test_found_constants_differ_from_the_true_ones_by_little() -> None:
    (trial,) = record_study(QUIET, [TrialPlan(kind="air_sweep")], calibration="found")
    true = float(str(trial.truth["volts_per_mn"]))
    assert trial.calibration.volts_per_mn != true
    assert trial.calibration.volts_per_mn == pytest.approx(true, rel=6e-3)


def test_a_finger_out_of_reach_is_said_in_one_line() -> None:
    settings = BenchSettings.from_toml("[specimens]\nsurface_low_mm = 8.9\nsurface_high_mm = 9.0")
    with pytest.raises(ValueError, match=r"no surface was found up to 9.5 mm") as caught:
        record_study(settings, [TrialPlan(contact_threshold_mn=450.0)])
    assert "\n" not in str(caught.value)


def test_the_fixture_gives_analysis_trials(bench_trials, as_trial) -> None:  # type: ignore[no-untyped-def]
    (trial,) = bench_trials("[specimens]\npublished_tissue = true", [TrialPlan(hold_s=0.2)])
    assert trial.kind == "ramp_hold_retract"
    assert trial.phase("hold") is not None
    assert as_trial(record_study(QUIET, [TrialPlan(kind="air_sweep")])[0]).kind == "air_sweep"
