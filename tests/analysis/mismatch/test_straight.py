from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from analysis.simulation.servo import follow
from analysis.simulation.straight import straightened

STEP_MM = 20.0 / 65536 / 2.042


@given(speed=st.floats(0.5, 20.0), at=st.integers(200, 900))
def test_a_ramp_in_converter_steps_is_commanded_as_a_line(speed: float, at: int) -> None:
    n = max(40, round(0.5 / speed * 8000))
    there = np.linspace(0.0, 0.5, n)
    command = np.concatenate([np.zeros(at), there, np.full(600, 0.5), there[::-1]])
    stepped = np.round(command / STEP_MM) * STEP_MM
    found = straightened(stepped, [at, at + n, at + n + 600])
    assert np.max(np.abs(found - command)) < 1.5 * STEP_MM


def test_steps_of_the_converter_do_not_accelerate_the_arm() -> None:
    command = np.concatenate([np.zeros(500), np.linspace(0.0, 2.0, 16000)])
    stepped = np.round(command / STEP_MM) * STEP_MM
    middle = slice(2000, -2000)
    rough = follow(stepped, 8000.0).acceleration_mm_s2[middle]
    smooth = follow(straightened(stepped, [500]), 8000.0).acceleration_mm_s2[middle]
    assert np.std(rough) > 100.0
    assert np.std(smooth) < 0.01 * np.std(rough)


def test_a_command_without_steps_comes_back_as_it_is() -> None:
    command = np.concatenate([np.zeros(500), np.linspace(0.0, 2.0, 16000)])
    assert straightened(command, [500]) is command
