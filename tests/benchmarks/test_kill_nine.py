"""Kill -9 at random moments of a trial of `indenter run`: what the file misses, and where the arm goes.

`pytest -m "slow and benchmark" -s tests/benchmarks/test_kill_nine.py`; KILLS lowers their number.
"""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import h5py
import numpy as np
import pytest

from analysis.recordings import read_trial
from analysis.recordings.rescue import rescue_paths
from rig.config import parse_rig
from rig.engine.announcing import announcements
from rig.engine.following import Follower
from rig.hardware.companion import Companion
from rig.hardware.remote import ControlService

KILLS = int(os.environ.get("KILLS", "100"))
BENCH = """
[companion]
command = ["{python}", "-m", "sim_hardware"]
[companion.settings]
seed = 3
time = "real"
"""
PROTOCOL = """
kind = "ramp_hold_retract"
[surface]
start_mm = 2.9
[indentation]
depth_mm = 0.4
dwell_s = 0.5
hold_s = 1.5
"""
SAFE_MM = 0.5


def first_sample_time(run: subprocess.Popen[bytes], for_s: float) -> float:
    """Follow the run for a while; return when its first sample was taken, s of the wall clock.

    A sample is seen some time after it was taken, never before: the earliest of many estimates counts.
    """
    found = announcements()
    while not found and run.poll() is None:
        time.sleep(0.01)
        found = announcements()
    assert found, run.communicate()
    rate, earliest = 8000.0, float("inf")
    with Follower(found[0]) as follower:
        deadline = time.time() + 60
        while not follower.ring.written and time.time() < deadline:
            time.sleep(0.002)
        until = time.time() + for_s
        while time.time() < until:
            earliest = min(earliest, time.time() - follower.ring.written / rate)
            time.sleep(0.002)
    return earliest


@pytest.mark.slow
@pytest.mark.benchmark
def test_kill_nine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("INDENTER_RUNTIME_DIR", str(tmp_path / "runs"))
    random = np.random.default_rng(5)
    settings = parse_rig(BENCH, "bench").companion
    assert settings is not None
    missing_ms, safe_ms, in_contact = [], [], 0
    with Companion(settings) as companion, ExitStack() as stack:
        control = ControlService(companion.resolve("companion:control"))
        rig, protocol = tmp_path / "rig.toml", tmp_path / "one.toml"
        protocol.write_text(PROTOCOL)
        stack.callback(control.close)
        address = companion.resolve("companion:control")
        rig.write_text(
            f'[card]\naddress = "{companion.resolve("companion:card")}"\nloopback_channel = "ai2"\n'
            f'[operator]\naddress = "{address}"\n[clock]\naddress = "{address}"\n'
        )
        runs = itertools.count()
        while len(missing_ms) < KILLS:
            i = next(runs)
            out = tmp_path / f"out{i}"
            command = [
                sys.executable,
                "-m",
                "rig.cli",
                "run",
                str(protocol),
                "--rig",
                str(rig),
                "--out",
                str(out),
            ]
            run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
            file = out / "index_0.40mm.h5"
            started = first_sample_time(run, random.uniform(0.3, 4.0))
            before = control.call("arm")
            run.send_signal(signal.SIGKILL)
            killed = time.time()
            while abs(control.call("arm")["position_mm"] - SAFE_MM) > 0.3:
                assert time.time() < killed + 20, "the arm never came to the safe position"
                time.sleep(0.002)
            safe_after_ms = 1e3 * (time.time() - killed)
            run.communicate()
            (tmp_path / "runs" / f"run-{run.pid}.json").unlink(missing_ok=True)
            h5py.File(file).close()
            rescue_paths([file])
            trial = read_trial(file)
            assert trial.status in {"recovered", "complete"}
            if trial.status == "complete":
                continue  # it had come to its end: no moment of the trial
            missing_ms.append(1e3 * (killed - started - trial.n_samples / trial.sample_rate_hz))
            safe_ms.append(safe_after_ms)
            in_contact += bool(before["in_contact"])
    missing, safe = np.array(missing_ms), np.array(safe_ms)
    print(
        f"\n{KILLS} kills, {in_contact} with the punch in the skin; every file opened and was rescued\n"
        f"missing at the end of the file: median {np.median(missing):.0f} ms, "
        f"maximum {missing.max():.0f} ms, within 100 ms {np.sum(missing <= 100)} of {len(missing)}\n"
        f"arm at the safe position after: median {np.median(safe):.0f} ms, maximum {safe.max():.0f} ms, "
        f"within 500 ms {np.sum(safe <= 500)} of {KILLS}"
    )
