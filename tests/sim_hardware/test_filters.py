"""Filters and wander: right in closed form, and the same in blocks of any size."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_hardware.filters import LowPass, Resonance
from sim_hardware.wander import Wander

STEP_S = 1 / 32000


def test_low_pass_is_exact_for_lines() -> None:
    """A ramp of slope a comes out as a (t - tau (1 - exp(-t / tau)))."""
    t = np.arange(2000) * STEP_S
    out = LowPass(2e-3, STEP_S)(3.0 * t)
    assert np.allclose(out, 3.0 * (t - 2e-3 * -np.expm1(-t / 2e-3)), atol=1e-12)


def test_low_pass_begins_settled_and_settles_again() -> None:
    low = LowPass(1e-2, STEP_S)
    assert np.allclose(low(np.full(50, 7.0)), 7.0)
    low.settle()
    assert low(np.array([3.0]))[0] == 3.0


def test_resonance_has_unit_gain_at_rest_and_rings_at_its_frequency() -> None:
    ring = Resonance(900.0, 0.05, STEP_S)(np.ones(32000))
    assert ring[-1] == pytest.approx(1.0, abs=1e-6)
    crossings = np.flatnonzero(np.diff(np.sign(ring[:1000] - 1)))
    assert 0.5 / np.diff(crossings).mean() / STEP_S == pytest.approx(900 * math.sqrt(1 - 0.05**2), rel=0.02)


@given(st.lists(st.integers(1, 300), min_size=1, max_size=20), st.integers(0, 2**20))
@settings(max_examples=30, deadline=None)
def test_blocks_of_any_size_agree(sizes: list[int], seed: int) -> None:
    signal = np.random.default_rng(seed).standard_normal(sum(sizes))
    edges = np.cumsum([0, *sizes])
    for make in (lambda: LowPass(1e-3, STEP_S), lambda: Resonance(300.0, 0.1, STEP_S)):
        whole = make()(signal)
        piecewise = make()
        parts = [piecewise(signal[a:b]) for a, b in itertools.pairwise(edges)]
        assert np.array_equal(whole, np.concatenate(parts))


def test_wander_has_unit_rms_and_its_integral() -> None:
    wander = Wander(np.random.default_rng(3), 0.05, 0.5)
    t = np.arange(0, 2000, 0.01)
    assert np.std(wander(t)) == pytest.approx(1.0, rel=0.05)
    assert np.allclose(np.gradient(wander.integral(t), t)[1:-1], wander(t)[1:-1], atol=1e-3)
