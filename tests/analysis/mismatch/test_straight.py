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


@given(level=st.floats(0.0, 1.0), seed=st.integers(0, 99))
def test_a_command_that_was_read_with_noise_is_a_line(level: float, seed: int) -> None:
    """Of 60,000 samples two were two codes off: the flicker of the others was then taken for motion."""
    ramp = np.linspace(0.0, 100.0, 1600)
    codes = level + np.concatenate([np.zeros(800), ramp, np.full(16000, 100.0)])
    noise = 0.3 * np.random.default_rng(seed).normal(size=len(codes))
    noise[[5000, 9000]] = (2.0, -2.0)
    found = straightened(np.round(codes + noise) * STEP_MM, [800, 2400])
    assert np.ptp(found[2400:]) < 0.1 * STEP_MM
    assert np.max(np.abs(found - codes * STEP_MM)) < STEP_MM
