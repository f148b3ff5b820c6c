"""Smoothing of a recorded motion: noise is no motion, neither at rest nor at the ends of a recording."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.simulation.smoothing import smoothed, steady_velocity, width_for_rest


@given(
    slope=st.floats(-10.0, 10.0),
    level=st.floats(-1e3, 1e3),
    width_samples=st.floats(0.3, 200.0),
    n=st.integers(3, 3000),
)
def test_a_line_stays_that_line_to_its_ends(slope: float, level: float, width_samples: float, n: int) -> None:
    line = level + slope * np.arange(float(n))
    wide = min(width_samples, n / 12.0)
    np.testing.assert_allclose(smoothed(line, wide), line, atol=1e-9 * max(1.0, float(np.abs(line).max())))


def test_the_last_sample_s_noise_is_no_motion() -> None:
    # seeds fixed; turned about its last sample a signal moves there by that sample's noise
    width_samples, off = 40.0, []
    for seed in range(200):
        noise = np.random.default_rng(seed).normal(size=2000)
        off.append(smoothed(noise, width_samples)[-1])
    of_a_line_s_end = 2.0 / np.sqrt(2.0 * width_samples)
    assert np.std(off) < 1.3 * of_a_line_s_end


def test_what_rests_has_no_velocity_and_what_moves_keeps_it() -> None:
    """False failures: 20 recordings in which noise exceeds its universal threshold once in a hundred."""
    moving_mm = np.concatenate([np.zeros(20_000), 2.5e-4 * np.arange(2000), np.full(20_000, 0.5)])
    still = 0
    for seed in range(20):
        recorded_mm = moving_mm + np.random.default_rng(seed).normal(scale=2.5e-4, size=len(moving_mm))
        velocity = steady_velocity(recorded_mm, 40.0)
        at_rest = np.concatenate([velocity[:19_600], velocity[22_400:]])
        still += not np.any(at_rest)
        assert velocity[20_400:21_600].mean() == pytest.approx(2.5e-4, rel=0.02)
    assert still >= 15


@pytest.mark.parametrize(("wander_mm", "widest"), [(0.0, np.inf), (2e-4, 400.0)])
def test_a_rest_is_smoothed_as_much_as_it_bears(wander_mm: float, widest: float) -> None:
    time_s = np.arange(64_000) / 8000.0
    true_mm = wander_mm * np.sin(2.0 * np.pi * 2.0 * time_s)
    recorded_mm = true_mm + np.random.default_rng(3).normal(scale=2.5e-4, size=len(time_s))
    width = width_for_rest(recorded_mm, np.ones_like(time_s), 40.0)
    assert 80.0 <= width <= widest
    error_mm, before_mm = (np.sqrt(np.mean((smoothed(recorded_mm, w) - true_mm) ** 2)) for w in (width, 40.0))
    assert error_mm < 0.75 * before_mm
