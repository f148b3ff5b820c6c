"""The servo's figures: 1.3 ms from 1 to 99 %, a lag of 2/wn behind a ramp."""

import numpy as np
import pytest

from analysis.simulation.servo import follow

RATE_HZ = 200_000.0


def test_critically_damped_step_takes_1_3_ms() -> None:
    # a command that is linear between samples can only step within one of them
    command = np.concatenate([np.zeros(10), np.ones(2000)])
    x = follow(command, RATE_HZ).position_mm
    rise_s = (np.argmax(x > 0.99) - np.argmax(x > 0.01)) / RATE_HZ
    assert rise_s == pytest.approx(1.3e-3, rel=0.05)


@pytest.mark.parametrize("wn", [2e3, 5e3, 9e3])
def test_lag_behind_a_ramp(wn: float) -> None:
    t = np.arange(4000) / 8000.0
    motion = follow(5.0 * t, 8000.0, wn, 1.0)
    lag_s = t[-1] - motion.position_mm[-1] / 5.0
    assert lag_s == pytest.approx(2.0 / wn, rel=1e-4)
    assert motion.velocity_mm_s[-1] == pytest.approx(5.0, rel=1e-9)
    assert motion.acceleration_mm_s2[-1] == pytest.approx(0.0, abs=1.0)


def test_velocity_and_acceleration_are_derivatives() -> None:
    t = np.arange(8000) / RATE_HZ
    motion = follow(np.sin(2 * np.pi * 50 * t), RATE_HZ)
    np.testing.assert_allclose(
        np.gradient(motion.position_mm, t)[2:-2], motion.velocity_mm_s[2:-2], atol=0.05
    )
    np.testing.assert_allclose(
        np.gradient(motion.velocity_mm_s, t)[200:-2], motion.acceleration_mm_s2[200:-2], rtol=1e-3, atol=40.0
    )


def test_a_held_command_is_that_of_lines_integrated_finely() -> None:
    """Each step drawn as 64 lines, the first of them steep; sampled before the next step begins."""
    rate_hz, fine = 8000.0, 64
    command = np.concatenate([np.zeros(5), np.cumsum(np.full(60, 0.0025)), np.full(40, 0.15)])
    held = follow(command, rate_hz, held=True)
    finely = follow(np.repeat(command, fine), rate_hz * fine)
    # a line takes one fine sample to rise
    np.testing.assert_allclose(held.position_mm[1:], finely.position_mm[fine::fine], atol=6e-5)
    lag_s = 0.5 / rate_hz
    drawn = follow(command, rate_hz)
    steady = slice(45, 60)
    behind = drawn.position_mm[steady] - held.position_mm[steady]
    assert behind == pytest.approx(20.0 * lag_s, rel=0.02)
    # on a steady ramp the arm is slowing down whenever it is sampled
    assert np.all(held.acceleration_mm_s2[steady] < -1e4)
    assert np.mean(np.diff(held.velocity_mm_s[steady])) == pytest.approx(0.0, abs=1e-6)
