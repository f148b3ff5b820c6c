"""An arm that is asked to leave does so by itself, whatever the program's thread does, and is not called back."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from rig.hardware.errors import LimitRefusedError
from rig.hardware.lever import Lever
from rig.hardware.retreat import straight_mm

SAFE_V = 0.5 * 2.042 - 10.0
ONE_STEP_V = 20 / 2**16


def way_mm(lever: Lever, to_mm: float, speed_mm_s: float = 20.0) -> np.ndarray:
    return straight_mm(lever.commanded_mm, to_mm, speed_mm_s=speed_mm_s, rate_hz=8000.0)


def in_the_air(lever: Lever) -> None:
    """Bring the arm to 4 mm, with recording on."""
    lever.retreat()
    lever.start_recording()
    playback = lever.play(way_mm(lever, 4.0))
    while not playback.done:
        lever.read(80)


def test_it_leaves_while_the_program_reads_nothing(bench_of: Callable[..., Any]) -> None:
    with bench_of(time="real") as bench, bench.lever() as lever:
        in_the_air(lever)
        lever.flee()
        began_s = time.monotonic()
        while abs(bench.arm()["command_v"] - SAFE_V) > 2 * ONE_STEP_V:
            assert time.monotonic() - began_s < 60.0, bench.arm()
            time.sleep(0.01)
        lever.retreat()
        assert lever.commanded_mm == pytest.approx(0.5)


def test_its_way_is_one_motion_at_the_retreats_speed(bench: Any) -> None:
    with bench.lever() as lever:
        in_the_air(lever)
        before = lever.read(1).stop
        lever.flee()
        first = lever.read(160).command_mm
        lever.halt()  # of a program that has not heard of it: nothing halts the way to safety
        lever.retreat()
        rest = lever.read(lever.acquired - before - 160).command_mm
        command_mm = np.concatenate([first, rest])
        steps_mm = np.diff(command_mm)
        assert np.abs(steps_mm).max() * 8000 < 50.0
        moving = np.flatnonzero(steps_mm < -0.5 * 40.0 / 8000)
        # from 4 mm to 0.5 mm at 40 mm/s, without a stop on the way
        assert moving[-1] - moving[0] == pytest.approx(3.5 / 40.0 * 8000, abs=40)
        assert command_mm[-1] == pytest.approx(0.5, abs=0.01)


def test_nothing_is_sent_until_it_has_been_brought_to_safety(bench: Any) -> None:
    with bench.lever() as lever:
        in_the_air(lever)
        lever.flee()
        lever.read(320)
        with pytest.raises(LimitRefusedError, match="retreat before the next motion"):
            lever.play(way_mm(lever, 5.0))
        lever.retreat()
        lever.play(way_mm(lever, 1.0))


def test_an_arm_at_its_safe_position_has_nowhere_to_flee_to(bench: Any) -> None:
    with bench.lever() as lever:
        lever.retreat()
        lever.start_recording()
        lever.flee()
        lever.read(320)
        assert lever.commanded_mm == pytest.approx(0.5)
