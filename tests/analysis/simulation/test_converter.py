"""A force rounded to a converter's levels: its mean, the way back, and noise as it was before."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtr

from analysis.simulation.converter import COARSE, LEAST_NOISE, Levels, levels_of

APART_MN = 0.33
N = 40_000

noises = st.floats(LEAST_NOISE, 1.0 / COARSE)
"""Of a coarse converter, in levels."""


@given(noise=noises, at=st.floats(-3.0, 3.0))
def test_a_mean_reading_is_that_of_rounded_noise(noise: float, at: float) -> None:
    levels = Levels(APART_MN, 0.1, noise * APART_MN)
    k = np.arange(-12, 13)
    share = ndtr((k + 0.5 - at) / noise) - ndtr((k - 0.5 - at) / noise)
    expected_mn = 0.1 + APART_MN * float(share @ k)
    found_mn = levels.mean_read(np.array([0.1 + APART_MN * at]))[0]
    assert found_mn == pytest.approx(expected_mn, abs=1e-4 * APART_MN)


@given(noise=st.floats(0.25, 1.0 / COARSE), begins=st.floats(-2.0, 2.0), slope=st.floats(-0.1, 0.1))
def test_what_rounding_did_to_a_mean_is_undone(noise: float, begins: float, slope: float) -> None:
    levels = Levels(APART_MN, -0.2, noise * APART_MN)
    force_mn = levels.at_mn + APART_MN * (begins + slope * np.arange(30))
    back_mn = levels.before_rounding(levels.mean_read(force_mn), np.full(30, 100.0))
    # over a wide mean, which goes on by a quarter of a level, a tenth of the error of 0.09 levels averages out, and
    # where a mean goes on by 0.4 of what the force does that is 0.02 levels of the force
    np.testing.assert_allclose(back_mn, force_mn, atol=0.03 * APART_MN)


def test_a_force_that_goes_on_by_levels_stays_as_it_was_read() -> None:
    levels = Levels(APART_MN, 0.0, 0.2 * APART_MN)
    force_mn = 0.7 * APART_MN * np.arange(30)
    np.testing.assert_array_equal(levels.before_rounding(force_mn, np.full(30, 100.0)), force_mn)


@pytest.mark.parametrize("noise", [0.17, 0.25])
def test_where_few_samples_lie_on_one_level_their_neighbours_tell_where(noise: float) -> None:
    """A force that goes over six levels in 16000 samples, in means of eight, by 400 samples at a time."""
    random = np.random.default_rng(9)
    levels = Levels(APART_MN, 0.0, noise * APART_MN)
    force_mn = APART_MN * np.linspace(0.0, 6.0, 16000)
    read_mn = APART_MN * np.round((force_mn + levels.noise_mn * random.standard_normal(16000)) / APART_MN)
    means_mn, true_mn = (x.reshape(-1, 8).mean(axis=1) for x in (read_mn, force_mn))
    found_mn = levels.before_rounding(means_mn, np.full(2000, 8.0))
    slow = np.full(50, 1.0 / 50.0)
    as_read, undone = (np.convolve(x - true_mn, slow, mode="valid") for x in (means_mn, found_mn))
    assert np.std(undone) < 0.4 * np.std(as_read)


@pytest.mark.parametrize("noise", [0.18, 0.25, 0.35, 0.45])
def test_levels_and_the_noise_before_them_are_found(noise: float) -> None:
    """Six sigmas of the noise's estimate are 4 % of it, where a force lies anywhere between levels as often."""
    random = np.random.default_rng(8)
    force_mn = np.linspace(40.0, 48.0, N) + noise * APART_MN * random.standard_normal(N)
    levels = levels_of(APART_MN * np.round(force_mn / APART_MN))
    assert levels is not None
    assert levels.apart_mn == pytest.approx(APART_MN, rel=1e-6)
    assert levels.at_mn / APART_MN == pytest.approx(round(levels.at_mn / APART_MN), abs=1e-6)
    assert levels.noise_mn == pytest.approx(noise * APART_MN, rel=0.04)


@pytest.mark.parametrize("apart_mn", [0.0, 0.05, 0.15])
def test_noise_that_goes_over_many_levels_shows_none(apart_mn: float) -> None:
    force_mn = 40.0 + 0.1 * np.random.default_rng(8).standard_normal(N)
    assert levels_of(apart_mn * np.round(force_mn / apart_mn) if apart_mn else force_mn) is None


def test_few_samples_of_little_noise_lie_on_no_levels() -> None:
    random = np.random.default_rng(8)
    few = np.sort(random.uniform(0.0, 40.0, 300)) + 1e-4 * random.standard_normal(300)
    assert levels_of(few) is None
    assert levels_of(np.full(300, 2.0)) is None


@given(seed=st.integers(0, 10**6), at=st.floats(-2.0, 2.0), noise=noises)
def test_noise_before_rounding_is_the_same_wherever_the_force_lies(
    seed: int, at: float, noise: float
) -> None:
    """Five sigmas each of its mean and its deviation: false failures in 1 of 10^4 runs of a hundred draws."""
    random = np.random.default_rng(seed)
    levels = Levels(APART_MN, 0.0, noise * APART_MN)
    force_mn = np.full(N, APART_MN * at)
    read_mn = APART_MN * np.round((force_mn + levels.noise_mn * random.standard_normal(N)) / APART_MN)
    error = levels.drawn_error(read_mn, force_mn, random) / levels.noise_mn
    assert abs(float(np.mean(error))) < 5.0 / np.sqrt(N)
    assert abs(float(np.std(error)) - 1.0) < 5.0 / np.sqrt(2.0 * N)


def test_what_was_read_far_off_is_far_off() -> None:
    levels = Levels(APART_MN, 0.0, 0.2 * APART_MN)
    error_mn = levels.drawn_error(np.array([-6.0, 6.0]), np.zeros(2), np.random.default_rng(0))
    np.testing.assert_allclose(np.sign(error_mn), [-1.0, 1.0])
    assert np.all(np.abs(error_mn) > 30.0 * levels.noise_mn)
