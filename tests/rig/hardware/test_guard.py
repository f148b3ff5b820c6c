"""The guard: acts when the program dies with the arm away, and only then."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.hardware.errors import GuardError
from rig.hardware.guard import Guard
from rig.settings.rig_file import RigFile

SAFE_V = 0.5 * 2.042 - 10.0
ONE_STEP_V = 20 / 2**16

PRESSING = """
import signal
import sys
import numpy as np
from pathlib import Path
from rig.settings.reading import load_rig
from rig.hardware.guard import Guard
from rig.hardware.lever import Lever

# a shell's background job is born deaf to Ctrl-C
signal.signal(signal.SIGINT, signal.default_int_handler)
rig = load_rig(Path(sys.argv[1]))
calibration = rig.calibration.nominal()
with Guard(rig, rig.card.address, calibration) as guard:
    with Lever(rig, rig.card.address, calibration, guard) as lever:
        lever.retreat()
        lever.start_recording()
        playback = lever.play(np.linspace(lever.commanded_mm, 6.0, 2400))
        while not playback.done:
            lever.read(80)
        print(guard.pid, flush=True)
        while True:
            lever.read(80)
"""

RESTING = """
        print(guard.pid, flush=True)
        while True:
            lever.read(80)
"""


@contextmanager
def pressing(rig_file: Path) -> Iterator[tuple[subprocess.Popen[bytes], int]]:
    """A program that holds the arm at 6 mm, and the process of its guard."""
    program = subprocess.Popen([sys.executable, "-c", PRESSING, str(rig_file)], stdout=subprocess.PIPE)
    assert program.stdout is not None
    try:
        yield program, int(program.stdout.readline())
    finally:
        program.kill()
        program.wait()
        program.stdout.close()


def seconds_until(condition: Callable[[], bool], within_s: float) -> float:
    began_s = time.monotonic()
    while not condition():
        assert time.monotonic() - began_s < within_s, "did not happen in time"
        time.sleep(0.002)
    return time.monotonic() - began_s


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return "Z" not in Path(f"/proc/{pid}/stat").read_text().split(")")[-1].split()[:1]


@pytest.fixture
def rig_file(real_time_bench: Any, tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(
        f"""
        [card]
        address = "{real_time_bench.card_address}"
        loopback_channel = "ai2"
        [guard]
        heartbeat_timeout_s = 0.6
        log_file = "{tmp_path / "guard.log"}"
        """
    )
    return path


def at_safety(bench: Any) -> bool:
    return bool(abs(bench.arm()["command_v"] - SAFE_V) < 2 * ONE_STEP_V)


def test_kill_9_brings_the_arm_to_safety(real_time_bench: Any, rig_file: Path, tmp_path: Path) -> None:
    with pressing(rig_file) as (program, guard):
        assert not at_safety(real_time_bench)
        program.kill()
        # 0.5 s on a machine of its own, which a test can't count on: the benchmark measures it
        seconds_until(lambda: at_safety(real_time_bench), within_s=20.0)
        seconds_until(lambda: not alive(guard), within_s=20.0)
    log = (tmp_path / "guard.log").read_text()
    assert "the program is gone" in log
    assert "arm moved from" in log


def test_a_program_killed_with_the_arm_safe_leaves_the_card_free(
    real_time_bench: Any, rig_file: Path, tmp_path: Path
) -> None:
    program = subprocess.Popen(
        [sys.executable, "-c", PRESSING.partition("        playback =")[0] + RESTING, str(rig_file)],
        stdout=subprocess.PIPE,
    )
    assert program.stdout is not None
    guard = int(program.stdout.readline())
    program.kill()
    program.wait()
    program.stdout.close()
    seconds_until(lambda: not alive(guard), within_s=20.0)
    assert "arm moved" not in (tmp_path / "guard.log").read_text()
    with real_time_bench.lever() as lever:
        assert lever.commanded_mm == pytest.approx(0.5, abs=0.002)


def test_a_program_that_hangs_is_relieved_of_the_arm(
    real_time_bench: Any, rig_file: Path, tmp_path: Path
) -> None:
    with pressing(rig_file) as (program, _):
        program.send_signal(signal.SIGSTOP)
        seconds_until(lambda: at_safety(real_time_bench), within_s=20.0)
        log = tmp_path / "guard.log"
        assert "no sign of life" in log.read_text()
        # the guard still has the card when the arm is there; a program that wakes up now would be in its way
        seconds_until(lambda: "arm moved from" in log.read_text(), within_s=20.0)
        program.send_signal(signal.SIGCONT)
        # it finds its tasks gone, and ends
        assert program.wait(20.0) == 1


def test_ctrl_c_is_the_programs_own_business(real_time_bench: Any, rig_file: Path, tmp_path: Path) -> None:
    with pressing(rig_file) as (program, guard):
        program.send_signal(signal.SIGINT)
        program.wait(20.0)
        assert at_safety(real_time_bench)
        seconds_until(lambda: not alive(guard), within_s=20.0)
    assert (tmp_path / "guard.log").read_text() == ""


def test_the_guard_keeps_the_bench_alive_until_the_arm_is_safe(bench_of: Callable[..., Any]) -> None:
    with bench_of(time="real") as bench:
        calibration = bench.rig.calibration.nominal()
        with Guard(bench.rig, bench.card_address, calibration, [bench.companion.stdin_fd]) as guard:
            process = bench.companion._process
            bench.companion._process = None
            process.stdin.close()
            time.sleep(0.5)
            assert process.poll() is None
            assert alive(guard.pid)
        process.wait(20.0)
        process.stdout.close()
        bench.companion._errors.close()


def test_without_the_guard_the_arm_is_not_moved(real_time_bench: Any) -> None:
    rig: RigFile = real_time_bench.rig
    with (
        Guard(rig, real_time_bench.card_address, rig.calibration.nominal()) as guard,
        real_time_bench.lever(guard=guard) as lever,
    ):
        lever.retreat()
        lever.start_recording()
        os.kill(guard.pid, signal.SIGKILL)
        assert guard._process is not None
        guard._process.wait()
        with pytest.raises(GuardError, match="guard process is gone"):
            lever.play(np.linspace(lever.commanded_mm, 2.0, 8000))
        lever.read(400)
        assert at_safety(real_time_bench)


def test_a_guard_that_cannot_reach_the_card_does_not_start(real_time_bench: Any) -> None:
    rig: RigFile = real_time_bench.rig
    with (
        pytest.raises(GuardError, match="did not start"),
        Guard(rig, "127.0.0.1:9", rig.calibration.nominal()),
    ):
        pass
