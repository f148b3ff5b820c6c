"""The calibration's lines find the constants, and their intervals hold as often as they say."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom, linregress

from rig.calibration.lines import force_constants, line_through, student_95


def test_line_agrees_with_scipy() -> None:
    random = np.random.default_rng(2)
    x = random.uniform(0, 1, 8)
    y = 2 * x + 1 + random.normal(0, 0.1, 8)
    line, other = line_through(x, y), linregress(x, y)
    assert line.slope == pytest.approx(other.slope)
    assert line.intercept == pytest.approx(other.intercept)
    assert line.slope_se == pytest.approx(other.stderr)
    assert line.intercept_se == pytest.approx(other.intercept_stderr)
    assert line.r2 == pytest.approx(other.rvalue**2)
    assert line.dof == 6
    assert line.residuals.sum() == pytest.approx(0, abs=1e-12)


def test_intervals_of_six_points_hold_at_95_percent() -> None:
    random = np.random.default_rng(3)
    x = 0.16 * np.arange(6)
    n = 2000
    held = 0
    for _ in range(n):
        line = line_through(x, 2.042 * x + random.normal(0, 2e-4, 6))
        held += abs(line.slope - 2.042) < student_95(line.dof) * line.slope_se
    # two-sided binomial test at 1e-4: a correct interval would fail one seed in ten thousand
    low, high = binom.ppf([5e-5, 1 - 5e-5], n, 0.95)
    assert low <= held <= high


def test_student_needs_more_than_two_sigmas_with_few_points() -> None:
    assert student_95(4) == pytest.approx(2.7764, abs=1e-4)
    assert math.isclose(student_95(10**6), 1.96, abs_tol=1e-3)


def test_a_weight_hung_twice_is_one_point_whatever_the_balance_says() -> None:
    random = np.random.default_rng(4)

    def hung(weight: str, mass_g: float) -> tuple[float, Any]:
        volts = 0.015 * 9.80665 * mass_g + random.normal(0, 1e-4, 800)
        held = SimpleNamespace(samples=slice(0, 800))
        return mass_g, SimpleNamespace(
            specimen=SimpleNamespace(site=weight), force_v=volts, phase=lambda _: held
        )

    weights = [
        hung(f"{mass_g:g} g", mass_g + slip) for slip in (0.0, 2e-4) for mass_g in (0.0, 10.0, 20.0, 30.0)
    ]
    found = force_constants(weights, weights[0][1], 9.80665, 1.0)
    assert found.line.dof == 2
    assert found.line.x == pytest.approx([9.80665 * (mass_g + 1e-4) for mass_g in (0.0, 10.0, 20.0, 30.0)])
    assert found.constants["volts_per_mn"].value == pytest.approx(0.015, rel=1e-3)
