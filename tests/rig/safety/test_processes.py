"""Processes that die, freeze or hang, one or two at once: the arm is clear, or the person is told to lift it."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import psutil
import pytest

from analysis.recordings import read_trial
from analysis.recordings.live.rescue import rescue_paths
from rig.hardware.errors import GuardError

HOLD = (
    'kind = "ramp_hold_retract"\n[surface]\nstart_mm = 2.9\n'
    "[indentation]\ndepth_mm = 0.4\ndwell_s = 0.3\nhold_s = 60.0\n"
)
STUDY = (
    'kind = "study"\n[study]\nfingers = ["index"]\ndepths_mm = [0.2]\nrepeats = 2\nrest_s = 20.0\n'
    "[surface]\nstart_mm = 2.9\n[indentation]\ndwell_s = 0.1\nhold_s = 0.2\n"
)
BUSY_S = 2.0
"""What a busy computer may take beyond the second within which the arm is clear or the person told."""


def kill(*pids: int) -> None:
    for pid in pids:
        os.kill(pid, signal.SIGKILL)


def freeze(*pids: int) -> None:
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)


def status_of(file: Path) -> str:
    with h5py.File(file, "r", locking=False) as opened:
        return str(opened.attrs["status"])


def safe(bench: Any) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rig.cli", "safe", "--rig", str(bench.folder / "rig.toml")]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize("what", ["guard killed", "guard frozen", "second guard killed"])
def test_without_its_guards_a_run_ends_with_the_arm_clear(real_bench: Any, what: str) -> None:
    rig = real_bench.rig_toml(timeout_s=1.5)
    with real_bench.program(HOLD, rig=rig) as run:
        run.until_pressed()
        first, second = run.guards
        {"guard killed": kill, "guard frozen": freeze, "second guard killed": kill}[what](
            second if what == "second guard killed" else first
        )
        real_bench.seconds_until_clear()
        assert run.wait() == 1
        assert "so the arm is not moved any further" in run.said
        assert read_trial(real_bench.folder / "out" / "index_0.40mm.h5").status == "aborted"
    # and the rig is free again
    assert safe(real_bench).returncode == 0


@pytest.mark.parametrize(
    "end",
    [
        lambda run: (kill(*run.guards), run.signal()),
        lambda run: (freeze(run.guards[0]), run.signal()),
        lambda run: (kill(run.guards[0]), run.signal()),
        lambda run: (kill(run.guards[1]), run.signal()),
        lambda run: (freeze(run.guards[1]), run.signal()),
        lambda run: (freeze(run.guards[0]), run.signal(signal.SIGSTOP)),
    ],
    ids=[
        "program and both guards killed",
        "guard frozen, program killed",
        "guard and program killed",
        "second guard and program killed",
        "second guard frozen, program killed",
        "guard and program frozen",
    ],
)
def test_after_two_failures_the_arm_is_clear_or_can_be_cleared(
    real_bench: Any, end: Callable[[Any], object], request: pytest.FixtureRequest
) -> None:
    with real_bench.program(HOLD, rig=real_bench.rig_toml(timeout_s=0.8)) as run:
        run.until_pressed()
        real_bench.largest_force_mn()
        all_dead = "both" in request.node.callspec.id
        assert len(run.guards) == 2
        end(run)
        ended_s = time.monotonic()
        if all_dead:
            # nobody is left who could move it: the person is told, and the next who comes takes the card
            time.sleep(1.0)
            assert not real_bench.clear
            done = safe(real_bench)
            assert done.returncode == 0, done.stderr
            assert "the arm is clear" in done.stdout
            assert "the program and its guards are gone" in run.said
        real_bench.seconds_until_clear()
        known_s = min(time.monotonic(), run.told_to_lift_s()) - ended_s
        assert known_s < 1.0 + BUSY_S
        assert real_bench.largest_force_mn() < 100.0
    path = real_bench.folder / "out" / "index_0.40mm.h5"
    rescue_paths([path])
    assert read_trial(path).n_samples > 4000


def test_of_a_run_that_dies_at_rest_nobody_is_told_to_lift_the_arm(real_bench: Any) -> None:
    with real_bench.program(STUDY, name="study") as run:
        file = real_bench.folder / "study" / "001_index_0.20mm_r1.h5"
        run._wait(file.exists, 60)
        run._wait(lambda: status_of(file) == "complete" and real_bench.clear, 60)
        kill(*run.guards, run.process.pid)
        run.wait()
        assert real_bench.clear
        assert "lift" not in run.said.lower()


def test_a_frozen_program_is_relieved_of_the_arm(real_bench: Any) -> None:
    with real_bench.program(HOLD, rig=real_bench.rig_toml(timeout_s=1.0)) as run:
        run.until_pressed()
        run.signal(signal.SIGSTOP)
        assert real_bench.seconds_until_clear() < 5.0


def test_a_host_that_stands_still_in_the_approach(real_bench: Any) -> None:
    slow = HOLD.replace("start_mm = 2.9", "start_mm = 2.0")
    with real_bench.program(slow, rig=real_bench.rig_toml(timeout_s=1.0)) as run:
        run.until_moving(2.2)
        for pid in run.guards:
            freeze(pid)
        run.signal(signal.SIGSTOP)
        began = real_bench.call("arm")["position_mm"]
        time.sleep(1.0)
        assert real_bench.call("arm")["position_mm"] - began < 0.06, "it stopped by itself"
        assert real_bench.largest_force_mn() < 25.0


def test_a_second_run_in_the_rest_of_the_first_is_refused(real_bench: Any) -> None:
    with real_bench.program(STUDY, name="study") as first:
        file = real_bench.folder / "study" / "001_index_0.20mm_r1.h5"
        first._wait(lambda: file.exists() and not real_bench.call("arm")["in_contact"], 60)
        first._wait(lambda: status_of(file) == "complete", 60)
        with real_bench.program(HOLD, name="other") as second:
            assert second.wait() == 1
            assert "another run has this rig: process" in second.said
            assert not list((real_bench.folder / "other").glob("*.h5"))
        done = safe(real_bench)
        assert done.returncode == 1
        assert "another run has this rig" in done.stderr
        assert first.process.poll() is None
        first.signal(signal.SIGINT)
        assert first.wait() == 130


def test_the_guard_is_heeded_while_the_program_reads_nothing(real_bench: Any) -> None:
    """The reader thread retreats by itself: the engine may be busy with anything."""
    from rig.hardware.guard import Guard
    from rig.hardware.lever import Lever
    from rig.hardware.retreat import straight_mm
    from rig.settings.reading import parse_rig

    rig = parse_rig(real_bench.rig_toml(timeout_s=30.0), "rig.toml")
    calibration = rig.calibration.nominal()
    with (
        Guard(rig, rig.card.address, calibration) as guard,
        Lever(rig, rig.card.address, calibration, guard) as lever,
    ):
        lever.retreat()
        lever.start_recording()
        playback = lever.play(straight_mm(lever.commanded_mm, 2.0, speed_mm_s=20.0, rate_hz=8000.0))
        while not playback.done:
            lever.read(80)
        second = psutil.Process(guard.pids[1])
        kill(guard.pid)
        real_bench.seconds_until_clear(within_s=5.0)
        with pytest.raises(GuardError, match="the guard process is gone"):
            lever.read(80)
    try:
        # the program has cleared the arm and told it: neither that program nor the next run is its business
        second.wait(timeout=2.0)
    finally:
        with contextlib.suppress(psutil.NoSuchProcess):
            second.kill()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_run_that_is_told_to_end_clears_the_arm_first(real_bench: Any, number: signal.Signals) -> None:
    # a signal is what is tested: the guard is not to be the quicker one on a busy computer
    with real_bench.program(HOLD, rig=real_bench.rig_toml(timeout_s=30.0)) as run:
        run.until_pressed()
        run.signal(number)
        assert run.wait() == 130
        assert real_bench.clear
        assert "stopping: moving the arm clear" in run.said
    assert read_trial(real_bench.folder / "out" / "index_0.40mm.h5").status == "aborted"


def test_a_long_quiet_hold_is_not_taken_for_silence(real_bench: Any) -> None:
    path = real_bench.run(
        HOLD.replace("hold_s = 60.0", "hold_s = 6.0"), rig=real_bench.rig_toml(timeout_s=2.0)
    )
    assert read_trial(path).status == "complete"


def test_a_dead_program_is_known_by_its_death_and_not_by_its_silence(real_bench: Any) -> None:
    with real_bench.program(HOLD, rig=real_bench.rig_toml(timeout_s=30.0)) as run:
        run.until_pressed()
        run.signal()
        assert real_bench.seconds_until_clear() < 10.0
