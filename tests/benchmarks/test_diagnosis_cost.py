"""What a diagnosis costs: time and peak memory of `indenter diagnose`, report included."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import measured

from analysis.recordings import write_trial
from sim_hardware.concealment.offline import record_trial, study_plans
from sim_hardware.settings import BenchSettings
from sim_hardware.world import World

_BENCH = """
seed = 3
[[effects]]
name = "adhesion"
pull_off_mn = 5.0
"""


@pytest.mark.benchmark
@pytest.mark.parametrize(("repeats", "limit_s"), [(5, 60.0), (25, 240.0)], ids=["20 trials", "100 trials"])
def test_time_and_memory(repeats: int, limit_s: float, tmp_path: Path, as_trial: Callable[..., Any]) -> None:
    """20 and 100 trials of 12 s at 8 kHz, the whole library, the report written."""
    world = World(BenchSettings.from_toml(_BENCH))
    plans = study_plans(repeats=repeats, hold_s=8.0)
    trials = tmp_path / "trials"
    trials.mkdir()
    length_s = 0.0
    for i, plan in enumerate(plans):
        trial = as_trial(record_trial(world, plan, first=i == 0))
        length_s = max(length_s, trial.n_samples / trial.sample_rate_hz)
        write_trial(trials / f"{i:03d}.h5", trial)
    used = measured.diagnose(trials, tmp_path / "out")
    assert not used["error"]
    report = used["report"]
    print(
        f"\n{len(plans)} trials of up to {length_s:.1f} s: {used['wall_s']:.0f} s ({used['cpu_s']:.0f} s of "
        f"processor), peak {used['peak_mb']:.0f} MB; said {report['verdict']} "
        f"{[m['name'] for m in report['mechanisms']]}; asked for: {limit_s:.0f} s, 2048 MB"
    )
    assert used["peak_mb"] < 2048
    # the processor's time, since the wall's is that of whatever else runs; two cores would have room for both
    assert used["cpu_s"] < 2 * limit_s
