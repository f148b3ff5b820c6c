"""Ten minutes of recording in real time, three channels to a file, both processors busy: no sample lost.

`pytest -m "slow and benchmark" -s tests/benchmarks/test_ten_minutes.py`; MINUTES shortens it.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import numpy as np
import pytest

from analysis.recordings import TrialHeader, TrialWriter, read_trial
from rig.engine.filing import Filing
from rig.engine.recorder import Recorder
from rig.engine.session import open_bench
from rig.protocols.waveforms import ramp_mm
from rig.settings.reading import parse_rig

MINUTES = float(os.environ.get("MINUTES", "10"))


@pytest.mark.slow
@pytest.mark.benchmark
def test_ten_minutes_without_a_gap(
    tmp_path: Path, real_time_rig: str, busy_processors: Callable[[], AbstractContextManager[None]]
) -> None:
    rig = parse_rig(real_time_rig, "rig.toml")
    with open_bench(rig, rig.calibration.nominal()) as bench, busy_processors():
        lever = bench.lever
        rate = lever.sample_rate_hz
        header = TrialHeader(
            kind="air_sweep", source=bench.source, sample_rate_hz=rate, calibration=lever.calibration
        )
        n = round(60 * MINUTES * rate)
        with TrialWriter(tmp_path / "long.h5", header, n) as writer, Filing(writer) as filing:
            recorder = Recorder(lever, writer, filing.note, filing.check, lambda _: None)
            lever.start_recording(filing.keep)
            began = time.monotonic()
            recorder.take_for(0.1)
            there, back = lever.commanded_mm, lever.commanded_mm + 2.0
            while recorder.n < n:
                playback = lever.play(ramp_mm(there, back, 2.0, rate))
                recorder.take_until(min(n, recorder.started(playback) + playback.n + 200))
                there, back = back, there
            took_s = time.monotonic() - began
            filing.end(n)
            lever.retreat()
            lever.stop_recording()
    trial = read_trial(tmp_path / "long.h5")
    # the command is a straight ramp between rests: a lost sample would be a step of twice its slope
    assert trial.command_mm is not None
    steps_um = 1e3 * np.abs(np.diff(trial.command_mm))
    slope_um = 1e3 * 2.0 / rate
    lost = n - trial.n_samples + int(np.sum(steps_um > 5 * slope_um))
    print(
        f"\n{MINUTES:g} min at {rate:g} Hz, {os.cpu_count()} busy processors: {trial.n_samples} of {n} "
        f"samples in the file, {lost} lost; the last came {1e3 * (took_s - n / rate):.0f} ms after its time"
    )
    assert lost == 0
