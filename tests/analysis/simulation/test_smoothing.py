"""Smoothing of a recorded motion: noise is no motion, neither at rest nor at the ends of a recording."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from analysis.simulation.smoothing import (
    averaged_noise,
    position_noise,
    sample_noise,
    smoothed,
    smoothed_as_it_bears,
    steady_velocity,
    width_for_rest,
)


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
        velocity = steady_velocity(recorded_mm, 2.5e-4, 40.0)
        at_rest = np.concatenate([velocity[:19_600], velocity[22_400:]])
        still += not np.any(at_rest)
        assert velocity[20_400:21_600].mean() == pytest.approx(2.5e-4, rel=0.02)
    assert still >= 15


@pytest.mark.parametrize(("wander_mm", "widest"), [(0.0, np.inf), (2e-4, 400.0)])
def test_a_rest_is_smoothed_as_much_as_it_bears(wander_mm: float, widest: float) -> None:
    time_s = np.arange(64_000) / 8000.0
    true_mm = wander_mm * np.sin(2.0 * np.pi * 2.0 * time_s)
    recorded_mm = true_mm + np.random.default_rng(3).normal(scale=2.5e-4, size=len(time_s))
    width = width_for_rest(recorded_mm, 2.5e-4, np.ones_like(time_s), 40.0)
    assert 80.0 <= width <= widest
    error_mm, before_mm = (np.sqrt(np.mean((smoothed(recorded_mm, w) - true_mm) ** 2)) for w in (width, 40.0))
    assert error_mm < 0.75 * before_mm


def minimum_jerk(n: int) -> np.ndarray:
    """Return a motion (n,) from nothing to one that begins and ends at rest."""
    u = np.linspace(0.0, 1.0, n)
    return 10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5


@pytest.mark.parametrize(
    ("ramp_mm", "evenly_samples"),
    [(0.45 * np.linspace(0.0, 1.0, 180), 2.0), (0.45 * minimum_jerk(338), 10.0)],
)
def test_what_is_smoothed_as_it_bears_turns_where_it_did(ramp_mm: np.ndarray, evenly_samples: float) -> None:
    """Ramps of 5 mm/s at 2000 samples/s, and rests: of one Gaussian for all, 1 or 5 ms, a ramp is too gentle.

    Seeds fixed; the mean of 30 recordings is known to 0.04 um.
    """
    widest_samples, bends, at_rest = 32.0, (2000, 2000 + len(ramp_mm)), slice(4000, None)
    true_mm = np.concatenate([np.zeros(bends[0]), ramp_mm, np.full(14_000, ramp_mm[-1])])
    found_mm, creeps = np.zeros_like(true_mm), 0.0
    for seed in range(30):
        noise_mm = np.random.default_rng(seed).normal(scale=3e-4, size=len(true_mm))
        position_mm, velocity_mm, _ = smoothed_as_it_bears(true_mm + noise_mm, 3e-4, widest_samples)
        off_mm = position_mm - true_mm
        # at rest nearly as good as the widest allowed
        assert np.std(off_mm[at_rest]) < 1.3 * np.std(smoothed(noise_mm, widest_samples)[at_rest])
        found_mm += off_mm / 30
        creeps += np.mean(velocity_mm[at_rest] != 0.0) / 30
        middle = slice(bends[0] + 60, bends[1] - 60)
        assert velocity_mm[middle].sum() == pytest.approx(np.gradient(true_mm)[middle].sum(), rel=0.01)
    # noise is beyond its universal threshold in one of ten such recordings
    assert creeps < 1e-3
    evenly_mm = smoothed(true_mm, evenly_samples) - true_mm
    moves = slice(bends[0] - 20, bends[1] + 20)
    assert 3.0 * np.abs(found_mm[moves]).max() < np.abs(evenly_mm[moves]).max()
    # within what a sample of the recording is off
    assert np.abs(found_mm[moves]).max() < 5e-4


def test_what_moves_begins_to_before_it_is_more_than_noise() -> None:
    """Bristles bend from the first micrometre: half of it is missed where a velocity has to be beyond all noise."""
    position_mm = np.concatenate([np.zeros(4000), 0.45 * minimum_jerk(338), np.full(4000, 0.45)])
    recorded_mm = position_mm + np.random.default_rng(4).normal(scale=3e-4, size=len(position_mm))
    velocity = smoothed_as_it_bears(recorded_mm, 3e-4, 10.0)[1]
    moving = np.flatnonzero(velocity[3900:4438]) + 3900
    assert 4000 <= moving[0] < 4011
    assert np.array_equal(moving, np.arange(moving[0], moving[-1] + 1))
    # without noise from where it does
    exact = np.flatnonzero(smoothed_as_it_bears(position_mm, 0.0, 10.0)[1])
    assert abs(exact[0] - 4000) < 3


def test_a_recording_at_rest_stays_there() -> None:
    assert not smoothed_as_it_bears(np.zeros(2000), 0.0, 10.0).any()


@given(step_um=st.floats(0.5, 10.0), noise_um=st.floats(0.0, 0.3), seed=st.integers(0, 2**32 - 1))
def test_a_position_is_known_no_better_than_its_converter(step_um: float, noise_um: float, seed: int) -> None:
    """At rest its samples are all alike, or now and then a level apart, by which noise is nothing or too much."""
    moved_um = 500.0 * np.concatenate([np.zeros(4000), minimum_jerk(200), np.ones(4000)])
    noisy_um = moved_um + noise_um * np.random.default_rng(seed).standard_normal(len(moved_um))
    recorded_um = step_um * np.round(noisy_um / step_um)
    assert position_noise(recorded_um) >= 0.999 * step_um / np.sqrt(12.0)
    # what no converter has rounded has no levels, also where it moves as evenly as from one to the next
    assert position_noise(500.0 * np.clip(np.arange(8200.0) / 200.0 - 20.0, 0.0, 1.0)) < 1e-9
    assert position_noise(moved_um) < 1e-3 * step_um
    if noise_um > 0.01:
        assert position_noise(noisy_um) == pytest.approx(sample_noise(noisy_um), rel=0.01)


def test_a_converter_s_steps_are_no_motion() -> None:
    """A ramp of 4 um a sample read to 2.4 um: its velocity is its own to a thirtieth; it was a fifth off, staircase."""
    ramp_mm = np.concatenate([np.zeros(2000), 4e-3 * np.arange(1.0, 176.0), np.full(2000, 0.7)])
    noisy_mm = ramp_mm + 2.5e-4 * np.random.default_rng(4).standard_normal(len(ramp_mm))
    recorded_mm = 2.39e-3 * np.round(noisy_mm / 2.39e-3)
    _, velocity, _ = smoothed_as_it_bears(recorded_mm, position_noise(recorded_mm), 640.0)
    np.testing.assert_allclose(velocity[2030:2145], 4e-3, rtol=0.03)
    assert not np.any(velocity[:1900])


@pytest.mark.parametrize("shared", [0.0, 0.5, 0.8])
def test_noise_that_neighbours_share_averages_out_less(shared: float) -> None:
    """White noise through one pole: a mean over many samples is as noisy as of white noise 1 / (1 - pole) times as
    large, which a sample does not show. Beside a ramp that begins and ends it is told to a seventh; seed fixed."""
    white = np.random.default_rng(52).standard_normal(40_000)
    noise = lfilter([1.0], [1.0, -shared], white)
    ramp = np.clip(np.arange(40_000.0) - 15_000.0, 0.0, 1_000.0)
    assert averaged_noise(ramp + noise, 40) == pytest.approx(1.0 / (1.0 - shared), rel=0.15)
    assert averaged_noise(noise[:100], 40) == 0.0
