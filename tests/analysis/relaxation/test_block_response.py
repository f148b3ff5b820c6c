"""Block means of the solid's answer: equal to means of the sampled answer, and with true derivatives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.relaxation.block_response import block_answer, block_rows
from analysis.relaxation.blocks import Blocks
from analysis.relaxation.response import arm_response

RATE_HZ = 1000.0


def blocks_of(edges: np.ndarray, position_mm: np.ndarray) -> Blocks:
    n = len(edges) - 1
    return Blocks(
        edges / RATE_HZ,
        position_mm,
        np.diff(edges).astype(float),
        np.full(n, 1 / RATE_HZ),
        np.zeros(n),
        edges,
    )


def random_blocks(seed: int) -> Blocks:
    rng = np.random.default_rng(seed)
    edges = np.concatenate([[0], np.cumsum(rng.integers(1, 60, 25))])
    return blocks_of(edges, np.concatenate([[0.0], np.cumsum(rng.normal(0.02, 0.05, 25))]))


def sampled_means(blocks: Blocks, contact_mm: float, tau_s: float) -> np.ndarray:
    """Sample the exact answer: knots where samples, block edges and contact changes are."""
    samples_s = np.arange(blocks.edges[-1]) / RATE_HZ
    above = blocks.position_mm - contact_mm
    at = np.flatnonzero((above[1:] > 0) != (above[:-1] > 0))
    crossings = blocks.knots_s[at] + above[at] / (above[at] - above[at + 1]) * np.diff(blocks.knots_s)[at]
    knots_s = np.unique(np.concatenate([samples_s, blocks.knots_s, crossings]))
    depth = np.maximum(np.interp(knots_s, blocks.knots_s, above), 0)
    rows = [depth, arm_response(depth, knots_s, tau_s)]
    sampled = np.array([row[np.searchsorted(knots_s, samples_s)] for row in rows])
    return np.add.reduceat(sampled, blocks.edges[:-1], axis=1) / blocks.counts


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31), st.floats(-0.3, 0.6), st.floats(2e-3, 20.0))
def test_means_are_those_of_the_samples(seed: int, contact_mm: float, tau_s: float):
    blocks = random_blocks(seed)
    got = block_answer(blocks, contact_mm, [tau_s]).rows
    np.testing.assert_allclose(got, sampled_means(blocks, contact_mm, tau_s), atol=1e-10)
    np.testing.assert_allclose(block_rows(blocks, contact_mm, [tau_s]), got, atol=1e-12)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31), st.floats(-0.2, 0.4), st.floats(5e-3, 5.0))
def test_slope_by_tau(seed: int, contact_mm: float, tau_s: float):
    blocks = random_blocks(seed)
    h = 1e-5 * tau_s
    up, down = (block_answer(blocks, contact_mm, [tau_s + d]).rows[1] for d in (h, -h))
    got = block_answer(blocks, contact_mm, [tau_s]).tau_slopes[0]
    np.testing.assert_allclose(got, (up - down) / (2 * h), atol=2e-6 * max(1.0, np.abs(got).max()))


@settings(max_examples=60, deadline=None)
@given(st.floats(0.011, 0.389).filter(lambda place: abs(place - 0.2) > 1e-6), st.floats(5e-3, 5.0))
def test_slope_by_contact(contact_mm: float, tau_s: float):
    # where the motion rests, at 0.2 mm, contact is made or not: no derivative there
    edges = np.array([0, 7, 30, 61, 100, 180, 260, 400, 401, 402, 600])
    blocks = blocks_of(edges, np.interp(edges, [0, 100, 260, 600], [0, 0.2, 0.2, 0.4]))
    h = 1e-7
    up, down = (block_answer(blocks, contact_mm + d, [tau_s]).rows for d in (h, -h))
    got = block_answer(blocks, contact_mm, [tau_s]).contact_slopes
    # a sample that contact passes within h has no derivative: its block is left out
    smooth = np.abs((up - down) / (2 * h) - got).max(axis=0) < 1e-4
    assert smooth.sum() >= len(smooth) - 2


def test_without_arms_only_depth():
    answer = block_answer(random_blocks(1), 0.0, [])
    assert answer.rows.shape == (1, 25)
    assert answer.tau_slopes.shape == (0, 25)


def test_never_in_contact_is_zero():
    assert not block_answer(random_blocks(2), 1e3, [0.1]).rows.any()


@pytest.mark.parametrize("tau_s", [1e-5, 1e5])
def test_extreme_times_stay_finite(tau_s: float):
    answer = block_answer(random_blocks(3), 0.0, [tau_s])
    assert np.all(np.isfinite(answer.rows)) and np.all(np.isfinite(answer.tau_slopes))
