"""Kill -9 at random moments of pressing: how long until the simulated card has the arm at the safe position.

`pytest -m benchmark -s tests/benchmarks/test_guard_speed.py`; aim: within 500 ms, every time. On a computer
that is busy with other work, run it with `nice -n -10`, or it measures that work.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from rig.hardware.companion import Companion
from rig.hardware.remote import ControlService
from rig.settings.reading import parse_rig

N_KILLS = int(os.environ.get("INDENTER_KILLS", "100"))
AIM_S = 0.5
SAFE_V = 0.5 * 2.042 - 10.0
NEAR_V = 0.001
BENCH = """
[companion]
command = ["{python}", "-m", "sim_hardware"]
[companion.settings]
seed = 3
time = "real"
loopback_wired = LOOPBACK
"""

PRESSING = """
import sys
from contextlib import nullcontext
from pathlib import Path
from rig.settings.reading import load_rig
from rig.hardware.guard import Guard
from rig.hardware.lever import Lever
from rig.hardware.retreat import straight_mm

rig = load_rig(Path(sys.argv[1]))
calibration = rig.calibration.nominal()
guard = Guard(rig, rig.card.address, calibration) if sys.argv[2] == "guarded" else nullcontext()
with guard as watching, Lever(rig, rig.card.address, calibration, watching) as lever:
    lever.retreat()
    lever.start_recording()
    print(watching.pid if watching is not None else 0, flush=True)
    for to_mm, speed_mm_s in [(4.0, 10.0), (5.0, 5.0), (4.0, 5.0), (0.5, 20.0)] * 100:
        way_mm = straight_mm(lever.commanded_mm, to_mm, speed_mm_s=speed_mm_s, rate_hz=lever.sample_rate_hz)
        playback = lever.play(way_mm)
        while not playback.done:
            lever.read(80)
"""


def seconds_to_safety(program: subprocess.Popen[bytes], control: ControlService, patience_s: float) -> float:
    """Kill the program; time until the arm is commanded to the safe position, s (inf: not in time)."""
    program.kill()
    killed_s = time.monotonic()
    while time.monotonic() - killed_s < patience_s:
        if abs(control.call("arm")["command_v"] - SAFE_V) < NEAR_V:
            return time.monotonic() - killed_s
        time.sleep(0.001)
    return float("inf")


@pytest.mark.benchmark
@pytest.mark.parametrize("wired", [True, False], ids=["loop-back wired", "not wired"])
def test_time_to_safety_after_kill_9(tmp_path: Path, wired: bool) -> None:
    bench = parse_rig(BENCH.replace("LOOPBACK", str(wired).lower()), "bench")
    assert bench.companion is not None
    rng = np.random.default_rng(20150601)
    with Companion(bench.companion) as companion:
        control = ControlService(companion.resolve("companion:control"))
        control.call("request", "place_finger", {"finger": "index", "site": "1", "repeat": 1})
        time.sleep(2.0)  # what the bench does only once is done before it is measured
        rig_file = tmp_path / "rig.toml"
        rig_file.write_text(
            f'[card]\naddress = "{companion.resolve("companion:card")}"\n'
            + ('loopback_channel = "ai2"\n' if wired else "")
            + f'[guard]\nlog_file = "{tmp_path / "guard.log"}"\n'
        )

        def killed(guarded: str, patience_s: float) -> float:
            program = subprocess.Popen(
                [sys.executable, "-c", PRESSING, str(rig_file), guarded], stdout=subprocess.PIPE
            )
            assert program.stdout is not None
            guard_pid = int(program.stdout.readline())
            time.sleep(float(rng.uniform(0.0, 1.5)))
            spent_s = seconds_to_safety(program, control, patience_s)
            program.wait()
            program.stdout.close()
            while guard_pid and psutil.pid_exists(guard_pid):
                time.sleep(0.01)  # it may still be freeing the card for the next program
            return spent_s

        n = N_KILLS if wired else N_KILLS // 4
        spent_s = np.array([killed("guarded", 5.0) for _ in range(n)])
        if wired:
            alone_s = killed("alone", 2.0)
        control.close()
    print(
        f"\n{n} kills, loop-back {'wired' if wired else 'not wired'}: at the safe position after "
        f"median {np.median(spent_s) * 1e3:.0f} ms, "
        f"95 % {np.quantile(spent_s, 0.95) * 1e3:.0f} ms, max {spent_s.max() * 1e3:.0f} ms; "
        f"within {AIM_S * 1e3:.0f} ms: {np.mean(spent_s <= AIM_S):.0%}"
    )
    if wired:
        print("without a guard: " + ("still pressed in after 2 s" if alone_s > 2 else f"{alone_s:.3f} s"))
    assert np.all(np.isfinite(spent_s))
    assert np.median(spent_s) < AIM_S
