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
from analysis.recordings.live.rescue import rescue_paths
from rig.engine.announcing import announcements
from rig.engine.following import Follower
from rig.engine.states import State
from rig.hardware.companion import Companion
from rig.hardware.remote import ControlService
from rig.settings.reading import parse_rig

RATE_HZ = 8000.0
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


class Watch:
    """Follows a run up to its death: what a kill at this moment finds."""

    def __init__(self, run: subprocess.Popen[bytes], stack: ExitStack) -> None:
        found = announcements()
        while not found and run.poll() is None:
            time.sleep(0.01)
            found = announcements()
        assert found, run.communicate()
        self._follower = stack.enter_context(Follower(found[0]))
        self._earliest = float("inf")
        self.over = False
        """The samples of the trial have all come: the arm is on its way to the safe position."""

    @property
    def written(self) -> int:
        """Samples that the run has shown."""
        return self._follower.ring.written

    def look_for(self, duration_s: float) -> None:
        """Look on for so long, counted from the first sample."""
        deadline = time.time() + 60
        while not self.written and time.time() < deadline:
            time.sleep(0.002)
        until = time.time() + duration_s
        while time.time() < until:
            self._look()
            time.sleep(0.002)
        self._look()

    def missing_ms(self, killed: float, n_samples: int) -> float:
        """What a file of so many samples misses of those taken before the kill, ms.

        A sample is seen some time after it was taken, never before: the earliest of many estimates of
        the first one's time counts.
        """
        taken = self.written if self.over else RATE_HZ * (killed - self._earliest)
        return 1e3 * (taken - n_samples) / RATE_HZ

    def _look(self) -> None:
        self._earliest = min(self._earliest, time.time() - self.written / RATE_HZ)
        snapshot = self._follower.snapshot(timeout_s=0)
        if snapshot is not None:
            self.over = snapshot.state in {State.LEAVING, State.SAVED, State.FINISHED}


@pytest.mark.slow
@pytest.mark.benchmark
def test_kill_nine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("INDENTER_RUNTIME_DIR", str(tmp_path / "runs"))
    random = np.random.default_rng(5)
    settings = parse_rig(BENCH, "bench").companion
    assert settings is not None
    missing_ms, safe_ms, in_contact, n_over = [], [], 0, 0
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
            followed = stack.enter_context(ExitStack())
            watch = Watch(run, followed)
            watch.look_for(random.uniform(0.3, 4.0))
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
                followed.close()
                continue  # it had come to its end: no moment of the trial
            missing_ms.append(watch.missing_ms(killed, trial.n_samples))
            followed.close()
            n_over += watch.over
            safe_ms.append(safe_after_ms)
            in_contact += bool(before["in_contact"])
    missing, safe = np.array(missing_ms), np.array(safe_ms)
    print(
        f"\n{KILLS} kills, {in_contact} with the punch in the skin, {n_over} on the way to safety after the trial; "
        "every file opened and was rescued\n"
        f"missing at the end of the file: median {np.median(missing):.0f} ms, "
        f"95 % {np.quantile(missing, 0.95):.0f} ms, maximum {missing.max():.0f} ms, "
        f"within 100 ms {np.sum(missing <= 100)} of {len(missing)}\n"
        f"arm at the safe position after: median {np.median(safe):.0f} ms, maximum {safe.max():.0f} ms, "
        f"within 500 ms {np.sum(safe <= 500)} of {KILLS}"
    )
