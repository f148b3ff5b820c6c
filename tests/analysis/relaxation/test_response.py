"""The solid's answer: against quadrature, against closed forms, and under the laws it must keep."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from analysis.relaxation.response import (
    arm_response,
    arm_response_and_slope,
    basis,
    force_response,
)

SEEDS = st.integers(0, 2**31)
TIMES = st.floats(1e-3, 1e2)


def random_walk(seed: int, n: int = 60) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.exponential(0.02, n)), np.cumsum(rng.normal(0, 0.05, n))


def test_convolution_integral_is_reproduced():
    time_s = np.array([0.0, 0.1, 0.13, 0.5, 0.9, 2.0])
    depth_mm = np.array([0.0, 0.2, 0.5, 0.5, 0.1, 0.4])
    slopes = np.diff(depth_mm) / np.diff(time_s)
    got = arm_response(depth_mm, time_s, 0.3)
    for i, t in enumerate(time_s):
        want = sum(
            quad(lambda s, v=v, t=t: v * np.exp(-(t - s) / 0.3), a, b)[0]
            for a, b, v in zip(time_s[:i], time_s[1 : i + 1], slopes[:i], strict=True)
        )
        assert got[i] == pytest.approx(want, abs=1e-12)


def test_ramp_and_hold_has_the_closed_form():
    rate_hz, ramp_s, tau_s = 8000.0, 0.08, 0.149
    time_s = np.arange(16000) / rate_hz
    depth_mm = 0.4 * np.minimum(time_s / ramp_s, 1.0)
    hold = time_s >= ramp_s
    want = 0.4 * tau_s / ramp_s * (1 - np.exp(-ramp_s / tau_s)) * np.exp(-(time_s[hold] - ramp_s) / tau_s)
    np.testing.assert_allclose(arm_response(depth_mm, 1 / rate_hz, tau_s)[hold], want, rtol=1e-11)


@settings(max_examples=60, deadline=None)
@given(SEEDS, TIMES)
def test_even_and_uneven_roads_agree(seed: int, tau_s: float):
    depth_mm = np.cumsum(np.random.default_rng(seed).normal(0, 0.05, 400))
    even = arm_response_and_slope(depth_mm, 0.01, tau_s, start_mm=0.3)
    uneven = arm_response_and_slope(depth_mm, np.arange(400) * 0.01, tau_s, start_mm=0.3)
    for a, b in zip(even, uneven, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-10 * np.abs(a).max())


@settings(max_examples=60, deadline=None)
@given(SEEDS, TIMES, st.floats(-3, 3), st.floats(-3, 3))
def test_linear_in_the_motion(seed: int, tau_s: float, p: float, q: float):
    time_s, one = random_walk(seed)
    _, two = random_walk(seed + 1)
    both = arm_response(np.stack([one, two]), time_s, tau_s)
    np.testing.assert_allclose(
        arm_response(p * one + q * two, time_s, tau_s), p * both[0] + q * both[1], atol=1e-11
    )


@settings(max_examples=60, deadline=None)
@given(SEEDS, TIMES, st.integers(1, 58))
def test_causal_and_independent_of_where_samples_fall(seed: int, tau_s: float, cut: int):
    time_s, depth_mm = random_walk(seed)
    whole = arm_response(depth_mm, time_s, tau_s)
    changed = depth_mm.copy()
    changed[cut + 1 :] += 1.0
    np.testing.assert_array_equal(arm_response(changed, time_s, tau_s)[: cut + 1], whole[: cut + 1])
    between = 0.5 * (time_s[cut] + time_s[cut + 1])
    finer_s = np.insert(time_s, cut + 1, between)
    finer = arm_response(np.insert(depth_mm, cut + 1, np.interp(between, time_s, depth_mm)), finer_s, tau_s)
    np.testing.assert_allclose(np.delete(finer, cut + 1), whole, atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(SEEDS, st.floats(5e-3, 20.0))
def test_slope_is_the_derivative_by_tau(seed: int, tau_s: float):
    time_s, depth_mm = random_walk(seed)
    _, slope = arm_response_and_slope(depth_mm, time_s, tau_s)
    h = 1e-5 * tau_s
    numeric = (arm_response(depth_mm, time_s, tau_s + h) - arm_response(depth_mm, time_s, tau_s - h)) / (
        2 * h
    )
    np.testing.assert_allclose(slope, numeric, atol=1e-7 * max(1.0, np.abs(numeric).max()))


def test_steps_far_longer_than_tau_neither_overflow_nor_vanish():
    time_s = np.array([0.0, 1.0, 2.0, 2.5, 1e4])
    got = arm_response(np.array([0.0, 1.0, 3.0, 3.0, 4.0]), time_s, 1e-3)
    np.testing.assert_allclose(got, [0, 1e-3, 2e-3, 0, 1e-3 / 9997.5], atol=1e-15)


def test_no_arms_is_a_spring_and_force_never_pulls():
    depth_mm = np.array([0.0, 0.5, 0.2])
    assert basis(depth_mm, 0.1, ()).shape == (1, 3)
    np.testing.assert_allclose(force_response(depth_mm, 0.1, 120.0), 120 * depth_mm)
    fast_back = np.array([0.0, 1.0, 1.0, 0.01])
    arms = [(500.0, 0.1)]
    assert force_response(fast_back, 0.1, 10.0, arms).min() == 0.0
    assert force_response(fast_back, 0.1, 10.0, arms, clip=False).min() < 0.0


@pytest.mark.parametrize("tau_s", [0.0, -1.0, np.inf, np.nan])
def test_impossible_times_are_refused(tau_s: float):
    with pytest.raises(ValueError, match="relaxation time"):
        arm_response(np.zeros(3), 0.1, tau_s)


@pytest.mark.parametrize("time", [0.0, -1.0, np.array([0.0, 1.0]), np.array([0.0, 1.0, 1.0])])
def test_impossible_sampling_is_refused(time: float | np.ndarray):
    with pytest.raises(ValueError):
        arm_response(np.zeros(3), time, 1.0)
