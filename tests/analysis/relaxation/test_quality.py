"""Every flag is raised by its fault, with a number that says how bad, and none by a good trial."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from analysis.recordings.trial import Event, Trial
from analysis.relaxation.fit import fit_trial
from analysis.relaxation.result import Check, Model, TrialFit

Simulate = Callable[..., Trial]
RATE_HZ = 8000.0


def raised(row: TrialFit) -> dict[str, Check]:
    return {check.name: check for check in row.checks if check.raised}


def hold_time(trial: Trial) -> np.ndarray:
    """Time since the ramp's end, negative before."""
    return trial.time_s - trial.phases[3].start / RATE_HZ


@pytest.mark.parametrize("model", ["ramp", "step"])
@pytest.mark.parametrize("depth_mm", [0.2, 0.8])
@pytest.mark.parametrize("seed", range(3))
def test_good_trials_have_no_flags(simulate: Simulate, model: Model, depth_mm: float, seed: int):
    row = fit_trial(simulate(depth_mm, seed=seed, clear_s=0.3), model)
    assert row.flags == ""
    assert len({check.name for check in row.checks}) == len(row.checks) >= 12


def moved(trial: Trial, mm: np.ndarray) -> Trial:
    """The lever moves without the command having said so; the tissue's force follows elastically."""
    shifted = trial.position_v + mm * trial.calibration.volts_per_mm
    return replace(trial, position_v=shifted, force_v=trial.force_v + 200.0 * mm * 0.015)


def faults() -> dict[str, tuple[str, Callable[[Trial], Trial]]]:
    def jump(trial: Trial) -> Trial:
        return replace(trial, force_v=trial.force_v - 0.015 * np.where(hold_time(trial) > 3.0, 1.0, 0.0))

    def ring(trial: Trial) -> Trial:
        t = hold_time(trial)
        wave = 3.0 * np.exp(-np.maximum(t, 0) / 0.02) * np.sin(2 * np.pi * 400 * t) * (t > 0)
        return replace(trial, force_v=trial.force_v + 0.015 * wave)

    def drift(trial: Trial) -> Trial:
        return replace(trial, force_v=trial.force_v + 0.015 * 0.3 * trial.time_s)

    def creep(trial: Trial) -> Trial:
        return moved(trial, 0.008 * np.clip(hold_time(trial) / 7.0, 0, 1))

    def left(trial: Trial) -> Trial:
        return moved(trial, -0.025 * np.clip((hold_time(trial) - 6.0) / 0.1, 0, 1))

    def lost(trial: Trial) -> Trial:
        return replace(
            trial, force_v=np.where(hold_time(trial) > 6.0, 0.0015 * np.sin(trial.time_s), trial.force_v)
        )

    def saturated(trial: Trial) -> Trial:
        return replace(trial, force_v=np.minimum(trial.force_v, 0.015 * 60.0))

    def slow_noise(trial: Trial) -> Trial:
        return replace(trial, force_v=trial.force_v + 0.015 * 0.2 * np.sin(2 * np.pi * 3.1 * trial.time_s))

    def third_time(trial: Trial) -> Trial:
        late = np.maximum(hold_time(trial), 0)
        return replace(trial, force_v=trial.force_v + 0.015 * 20.0 * (np.exp(-late / 20.0) - 1.0))

    def too_shallow(trial: Trial) -> Trial:
        return replace(trial, protocol=replace(trial.protocol, depth_mm=0.5))

    def cut_short(trial: Trial) -> Trial:
        return replace(trial, protocol=replace(trial.protocol, hold_s=14.0))

    def control(trial: Trial) -> Trial:
        at = trial.phases[3].start + 4000
        return replace(trial, events=(Event(at, "control_mode", "from position to force"),))

    return {
        "jump": ("motion_artefact", jump),
        "ring": ("ringing", ring),
        "drift": ("drift", drift),
        "creep": ("hold_not_constant", creep),
        "left": ("control_mode_changed", left),
        "lost": ("contact_lost", lost),
        "saturated": ("saturation", saturated),
        "slow_noise": ("residual_not_white", slow_noise),
        "third_time": ("window_unstable", third_time),
        "too_shallow": ("depth_missed", too_shallow),
        "cut_short": ("incomplete", cut_short),
        "control": ("control_mode_changed", control),
    }


@pytest.mark.parametrize("model", ["ramp", "step"])
@pytest.mark.parametrize("fault", list(faults()))
def test_a_fault_raises_its_flag_with_a_number(simulate: Simulate, fault: str, model: Model):
    name, spoil = faults()[fault]
    row = fit_trial(spoil(simulate(0.4, seed=1, clear_s=0.4)), model)
    if not row.fitted:
        assert fault in ("lost", "saturated", "left")
        return
    found = raised(row)
    assert name in found, row.flags
    check = found[name]
    assert np.isfinite(check.value)
    assert f"{name}=" in row.flags
    assert abs(check.value) > 0


def test_numbers_are_those_of_the_fault(simulate: Simulate):
    made = faults()
    trial = simulate(0.4, seed=1, clear_s=0.4)

    def number(fault: str) -> float:
        name, spoil = made[fault]
        return raised(fit_trial(spoil(trial)))[name].value

    assert number("jump") == pytest.approx(-1.0, abs=0.4)
    assert number("creep") == pytest.approx(8.0, rel=0.2)
    assert number("left") == pytest.approx(6.0, abs=0.3)
    assert number("drift") == pytest.approx(0.3 * 9.5, rel=0.3)
    assert number("too_shallow") == pytest.approx(-100.0, rel=0.02)
    assert number("control") == pytest.approx(0.5)
    assert number("cut_short") == pytest.approx(50.0, rel=0.01)
    shallow = raised(fit_trial(made["too_shallow"][1](trial)))["depth_missed"]
    assert shallow.text == "the ramp ended 100 um short of the protocol's depth"


def test_times_that_this_hold_does_not_tell(simulate: Simulate):
    row = fit_trial(simulate(0.4, hold_s=0.5, seed=2))
    assert "times_not_identifiable" in raised(row) or not row.fitted
    one_arm = fit_trial(simulate(0.4, arms=((0.371, 2.279),), seed=2))
    assert "times_not_identifiable" in raised(one_arm) or not one_arm.fitted


def test_step_fit_says_that_the_force_was_not_zeroed(simulate: Simulate):
    row = fit_trial(simulate(0.4, offset_mn=4.0), "step")
    assert raised(row)["force_offset"].value == pytest.approx(4.0, abs=0.1)
    assert "force_offset" not in fit_trial(simulate(0.4, offset_mn=4.0)).flags


def without(trial: Trial, **changes: Any) -> Trial:
    return replace(trial, **changes)


@pytest.mark.parametrize("model", ["ramp", "step"])
@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"kind": "air_sweep"}, "air sweep"),
        ({"kind": "rigid_target"}, "rigid target"),
        ({"phases": ()}, "no phase named hold"),
        ({"force_v": np.zeros(80000)}, "never changes"),
        ({"force_v": np.full(80000, np.nan)}, "finite"),
    ],
)
def test_hopeless_trials_keep_their_reason(simulate: Simulate, changes: Any, reason: str, model: Model):
    trial = simulate(0.4)
    if "force_v" in changes:
        changes = {"force_v": changes["force_v"][: trial.n_samples]}
    row = fit_trial(replace(trial, **changes), model)
    assert not row.fitted
    assert reason in row.failure
    assert row.flags == f"not fitted: {row.failure}"


@pytest.mark.parametrize("model", ["ramp", "step"])
def test_short_hold_and_upside_down_force_are_refused(simulate: Simulate, model: Model):
    trial = simulate(0.4)
    hold = trial.phases[3]
    short = replace(trial, phases=(*trial.phases[:3], replace(hold, stop=hold.start + 10)))
    assert "too short" in fit_trial(short, model).failure
    assert not fit_trial(replace(trial, force_v=-trial.force_v), model).fitted


def test_discarded_trials_keep_their_row(simulate: Simulate):
    row = fit_trial(replace(simulate(0.4), discarded="the finger moved"))
    assert row.fitted
    assert row.flags.startswith("discarded: the finger moved")
