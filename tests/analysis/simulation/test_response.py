"""The recursion on uneven cells against the relaxation room's, and the laws that any linear solid keeps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from analysis.relaxation.response import arm_response
from analysis.simulation.response import Steps, arm_force, arms_force, low_pass, resonance

LENGTHS_S = (1.25e-4, 1e-3, 8e-3)


def _axis(seed: int, n: int = 200) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    time_s = np.cumsum(rng.choice(LENGTHS_S, n))
    return time_s, rng.normal(size=n)


@given(st.integers(0, 10_000), st.floats(1e-3, 100.0))
@settings(max_examples=40, deadline=None)
def test_agrees_with_the_relaxation_room(seed: int, tau_s: float) -> None:
    time_s, drive = _axis(seed)
    ours = arm_force(drive, Steps.between(time_s), tau_s)
    np.testing.assert_allclose(ours, arm_response(drive, time_s, tau_s), atol=1e-9)


@given(st.integers(0, 10_000), st.floats(-3, 3), st.floats(-3, 3))
@settings(max_examples=30, deadline=None)
def test_superposition(seed: int, a: float, b: float) -> None:
    time_s, first = _axis(seed)
    second = np.random.default_rng(seed + 1).normal(size=len(first))
    steps, taus, weights = Steps.between(time_s), np.array([0.02, 0.5]), np.array([2.0, 3.0])
    both = arms_force(a * first + b * second, steps, taus, weights)
    apart = a * arms_force(first, steps, taus, weights) + b * arms_force(second, steps, taus, weights)
    np.testing.assert_allclose(both, apart, atol=1e-9)


@given(st.integers(0, 10_000), st.integers(1, 198))
@settings(max_examples=30, deadline=None)
def test_causality(seed: int, at: int) -> None:
    time_s, drive = _axis(seed)
    steps = Steps.between(time_s)
    later = drive.copy()
    later[at:] += 1.0
    np.testing.assert_array_equal(arm_force(drive, steps, 0.1)[:at], arm_force(later, steps, 0.1)[:at])


def test_low_pass_solves_its_equation() -> None:
    time_s = np.linspace(0, 0.1, 801)
    force = np.minimum(time_s / 0.03, 1.0)
    solved = solve_ivp(
        lambda t, y: (np.interp(t, time_s, force) - y) / 0.004,
        (0, 0.1),
        [0.0],
        t_eval=time_s,
        rtol=1e-9,
        atol=1e-12,
    )
    np.testing.assert_allclose(low_pass(force, Steps.between(time_s), 0.004), solved.y[0], atol=2e-6)


@given(st.integers(0, 10_000), st.integers(0, 5), st.integers(1, 5))
@settings(max_examples=30, deadline=None)
def test_many_rows_are_answered_independently(seed: int, rows: int, arms: int) -> None:
    time_s, drive = _axis(seed)
    steps, rng = Steps.between(time_s), np.random.default_rng(seed)
    drives = np.multiply.outer(np.linspace(-1.0, 2.0, rows), drive)
    taus_s, weights = np.geomspace(0.01, 3.0, arms), rng.random(arms)
    together = arms_force(drives, steps, taus_s, weights)
    assert together.shape == drives.shape
    for row, alone in zip(together, drives, strict=True):
        np.testing.assert_allclose(row, arms_force(alone, steps, taus_s, weights), atol=1e-12)
        one_by_one = sum(w * arm_force(alone, steps, tau_s) for tau_s, w in zip(taus_s, weights, strict=True))
        np.testing.assert_allclose(row, one_by_one, atol=1e-11)


@pytest.mark.parametrize("tau_s", [1e-7, 1e7])
def test_extremes_are_a_dashpot_and_a_spring(tau_s: float) -> None:
    time_s, drive = _axis(5)
    force = arm_force(drive, Steps.between(time_s), tau_s)
    expected = np.zeros_like(drive) if tau_s < 1 else drive - drive[0]
    np.testing.assert_allclose(force, expected, atol=1e-2)


@pytest.mark.parametrize(("period_s", "damping_ratio"), [(4e-4, 0.1), (3e-3, 0.5), (1e-3, 0.98)])
def test_resonance_solves_its_equation(period_s: float, damping_ratio: float) -> None:
    time_s = np.linspace(0, 0.05, 401)
    force = np.minimum(time_s / 0.005, 1.0)

    def rate(t: float, y: np.ndarray) -> list[float]:
        pull = float(np.interp(t, time_s, force)) - y[0] - 2.0 * damping_ratio * period_s * y[1]
        return [y[1], pull / period_s**2]

    solved = solve_ivp(rate, (0, 0.05), [0.0, 0.0], t_eval=time_s, rtol=1e-9, atol=1e-12, max_step=1e-4)
    rung = resonance(force, Steps.between(time_s), period_s, damping_ratio)
    np.testing.assert_allclose(rung, solved.y[0], atol=1e-6)
