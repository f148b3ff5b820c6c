"""Single samples at rest: a heavy tail of the noise is no event, and what happens is no tail."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.simulation.samples import FAR, NEIGHBOURS, kept_by_mean, winsorised

N = 400
WHITE_MN = 0.2


@given(
    seed=st.integers(0, 10**6),
    at=st.integers(NEIGHBOURS, N - NEIGHBOURS - 1),
    sign=st.sampled_from([-1.0, 1.0]),
)
def test_a_sample_far_off_counts_as_far_as_noise_is(seed: int, at: int, sign: float) -> None:
    noise_mn = np.random.default_rng(seed).normal(0.0, WHITE_MN, N)
    spark_mn = noise_mn + 20.0 * sign * (np.arange(N) == at)
    everywhere = np.full(N, True)
    found_mn = winsorised(spark_mn, everywhere)
    # five sigmas of a robust deviation of 400 samples, and of a median of nine: false failures below 1e-5
    assert sign * found_mn[at] == pytest.approx(FAR * WHITE_MN, rel=0.5)
    others = np.arange(N) != at
    np.testing.assert_array_equal(found_mn[others], spark_mn[others])
    np.testing.assert_array_equal(winsorised(spark_mn, np.arange(N) != at), spark_mn)


@given(
    seed=st.integers(0, 10**6),
    height_mn=st.floats(-50.0, 50.0),
    rise=st.integers(1, 100),
    slope_mn=st.floats(-0.1, 0.1),
)
@settings(max_examples=200)
def test_a_step_and_a_slope_stay_as_they_are(seed: int, height_mn: float, rise: int, slope_mn: float) -> None:
    """A step however steep, a slope of half the noise a sample: 800 mN/s where 8000 are taken in a second.

    Normal noise is as far off as 8 deviations once in 10^12 of these samples.
    """
    noise_mn = np.random.default_rng(seed).normal(0.0, WHITE_MN, N)
    at = np.arange(N) - N // 2
    force_mn = noise_mn + height_mn * np.clip(at / rise, 0.0, 1.0) + slope_mn * at
    np.testing.assert_allclose(winsorised(force_mn, np.full(N, True)), force_mn, atol=1e-9)


def test_a_mean_keeps_less_of_what_forgets_itself_within_it() -> None:
    """As the double integral of exp(-|t - t'|) over what is averaged, and all of it over nothing."""
    times = np.array([0.0, 1e-4, 0.1, 1.0, 30.0])
    t = (np.arange(1000) + 0.5) / 1000
    apart = np.abs(t[:, None] - t)
    expected = [np.exp(-u * apart).mean() for u in times]
    np.testing.assert_allclose(kept_by_mean(times), expected, rtol=1e-3)
    assert np.all(np.diff(kept_by_mean(np.geomspace(1e-5, 1e3, 200))) < 0.0)
