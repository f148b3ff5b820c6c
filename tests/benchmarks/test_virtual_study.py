"""The published study, simulated, recorded and written through the driver's own client.

`pytest -m benchmark -s tests/benchmarks/test_virtual_study.py`
"""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from analysis.recordings import read_trial
from rig.commands.run import load_rig_or_simulated
from rig.engine.interrupts import Interrupts
from rig.engine.progress import clock_words
from rig.engine.runner import Runner, Task
from rig.engine.session import open_bench
from rig.protocols.planning import plan_of
from rig.settings.reading import parse_protocol

TRIALS = 86
STUDY = """
kind = "study"
[study]
rest_s = [120.0, 180.0]
surface_positions_mm = [4.0]
[surface]
start_mm = 2.5
samples_per_read = 40
"""


@pytest.mark.benchmark
def test_86_trials_with_their_rests(tmp_path: Path) -> None:
    rig = load_rig_or_simulated(None)
    plan = plan_of(parse_protocol(STUDY, "study"), 0.5, STUDY)
    tasks = [Task(trial, tmp_path / f"{trial.name}.h5") for trial in plan.trials[:TRIALS]]
    began = time.monotonic()
    with open_bench(rig, rig.calibration.nominal()) as bench:
        before_s = bench.clock.time_s()
        Runner(bench, Interrupts()).run(plan, tasks, tmp_path)
        bench_s = bench.clock.time_s() - before_s
    took_s = time.monotonic() - began
    trials = [read_trial(task.path) for task in tasks]
    recorded_s = sum(trial.n_samples / trial.sample_rate_hz for trial in trials)
    print(
        f"\n{TRIALS} trials, {recorded_s / TRIALS:.1f} s each, {clock_words(bench_s)} of bench time: "
        f"{took_s:.1f} s, {bench_s / took_s:.0f} times as fast (aim: below 90 s)"
    )
    assert all(trial.status == "complete" for trial in trials)
    assert bench_s > 120 * (TRIALS - 1)
