"""Recordings at any rate, with and without a command, evenly sampled or not: a report, and never a traceback."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.name.oscillations import scan_oscillations
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings import write_trial
from analysis.recordings.trial import Trial
from rig.cli import main

KINDS: dict[str, dict[str, Any]] = {
    "5 Hz": {"rate_hz": 5.0, "times_s": (40.0, 4.0), "hold_s": 100.0, "ramp_s": 8.0},
    "5 Hz, ramp of 5 samples": {"rate_hz": 5.0, "times_s": (40.0, 4.0), "hold_s": 100.0, "ramp_s": 1.0},
    "10 Hz": {"rate_hz": 10.0, "times_s": (40.0, 4.0), "hold_s": 100.0, "ramp_s": 8.0},
    "10 Hz, ramp of 4 samples": {"rate_hz": 10.0, "ramp_s": 0.4},
    "50 Hz": {"rate_hz": 50.0, "ramp_s": 0.3},
    "50 Hz, uneven": {"rate_hz": 50.0, "ramp_s": 0.3, "uneven": True},
    "100 Hz": {"rate_hz": 100.0, "ramp_s": 0.2},
    "100 Hz, ramp of 2 samples": {"rate_hz": 100.0, "ramp_s": 0.02},
    "2000 Hz": {"rate_hz": 2000.0},
    "2000 Hz, uneven": {"rate_hz": 2000.0, "uneven": True},
    "100 kHz": {"rate_hz": 1e5, "times_s": (0.3, 0.03), "hold_s": 1.0},
}


@pytest.fixture(scope="module")
def convex() -> Callable[..., Trial]:
    path = Path(__file__).parents[1] / "relaxation" / "conftest.py"
    spec = spec_from_file_location("convex_simulator_of_diagnosis", path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    function: Callable[..., Trial] = module.simulate_convex
    return function


def with_command(trial: Trial) -> Trial:
    """Return the trial with a command that its position follows to a tenth of a micrometre."""
    noise = np.random.default_rng(1).normal(size=trial.n_samples) * 1e-4
    return replace(trial, command_v=trial.position_v, position_v=trial.position_v + noise)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("commanded", [False, True])
def test_every_recording_is_taken_in(kind: str, commanded: bool, convex: Callable[..., Trial]) -> None:
    trials = [convex(1.5, seed=seed, signal_to_noise=500.0, **KINDS[kind]) for seed in (0, 1)]
    taken = take_in_memory([with_command(trial) if commanded else trial for trial in trials])
    assert taken.left_out == ()
    first, second = taken.trials
    assert first.condition == second.condition
    for cells in taken.trials:
        assert np.isfinite(cells.force_mn).all()
        assert np.isfinite(cells.velocity_mm_s).all()
        assert cells.depth_mm == pytest.approx(0.4, rel=0.5)  # where a fit begins


def test_no_rhythm_is_looked_for_that_so_few_samples_do_not_bear(convex: Callable[..., Trial]) -> None:
    """Of a hundred samples in minutes a tremor of 10 Hz would explain whatever is there."""
    trials = [convex(1.5, seed=seed, signal_to_noise=500.0, **KINDS["5 Hz"]) for seed in (0, 1, 2)]
    scan = scan_oscillations(fit_baseline(take_in_memory(trials).trials))
    assert 1.0 < scan.grid_hz[-1] <= 2.5


def diagnosed(trials: list[Trial], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    folder = tmp_path / "trials"
    folder.mkdir()
    for number, trial in enumerate(trials):
        write_trial(folder / f"trial_{number}.h5", trial)
    assert main(["diagnose", str(folder), "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr()
    report: dict[str, Any] = json.loads((tmp_path / "out" / "report.json").read_text())
    assert shown.out.strip() == str(tmp_path / "out" / "report.html")
    assert shown.err.startswith(report["verdict"])
    assert "Traceback" not in shown.err
    return report


@pytest.mark.parametrize("kind", ["5 Hz, ramp of 5 samples", "10 Hz, ramp of 4 samples", "50 Hz, uneven"])
def test_slow_recordings_are_diagnosed(
    kind: str, convex: Callable[..., Trial], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trial = with_command(convex(2.0, seed=0, signal_to_noise=500.0, **KINDS[kind]))
    report = diagnosed([trial], tmp_path, capsys)
    assert report["n_trials"] == 1
    assert (
        report["verdict"] != "no_mismatch"
    )  # force grows as the square of depth, a straight line's does not


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("commanded", [False, True])
def test_every_recording_is_diagnosed(
    kind: str,
    exponent: float,
    commanded: bool,
    convex: Callable[..., Trial],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    trial = convex(exponent, seed=0, signal_to_noise=500.0, **KINDS[kind])
    report = diagnosed([with_command(trial) if commanded else trial], tmp_path, capsys)
    found = {m["name"]: m["parameters"] for m in report["mechanisms"]}
    print(f"{kind}, p = {exponent}, command {commanded}: {report['verdict']} {found}")
