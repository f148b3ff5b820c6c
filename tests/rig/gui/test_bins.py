"""Bins lose no peak, never move while the view rolls, and show a gap as a gap."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.gui.bins import BIN, Bins, fine_trace

RATE = 8000.0


def filled(samples: np.ndarray, cuts: list[int], first: int = 0) -> Bins:
    bins = Bins(RATE, seconds=len(samples) / RATE + 60)
    for start, stop in zip([0, *cuts], [*cuts, len(samples)], strict=True):
        bins.add(first + start, np.array([samples[start:stop], -samples[start:stop]]))
    return bins


@given(
    n=st.integers(1, 3000),
    cuts=st.lists(st.integers(0, 3000), max_size=12),
    first=st.integers(0, 10**7),
    most=st.integers(2, 200),
    seed=st.integers(0, 2**32 - 1),
)
def test_no_extreme_is_lost_however_the_samples_come(
    n: int, cuts: list[int], first: int, most: int, seed: int
) -> None:
    samples = np.random.default_rng(seed).standard_normal(n)
    bins = filled(samples, sorted(min(cut, n) for cut in cuts), first)
    for channel, sign in ((0, 1), (1, -1)):
        trace = bins.trace(channel, first, first + n, most)
        assert np.nanmax(trace.values) == pytest.approx((sign * samples).max(), rel=1e-6)
        assert np.nanmin(trace.values) == pytest.approx((sign * samples).min(), rel=1e-6)
        assert len(trace.index) <= 2 * (most + 1)
        assert np.all(np.diff(trace.index) >= 0)


@given(shift=st.integers(0, 5000), span=st.integers(2000, 40000), pixels=st.integers(50, 400))
def test_a_spike_of_a_millisecond_stands_in_its_place_while_the_view_rolls(
    shift: int, span: int, pixels: int
) -> None:
    samples = np.zeros(60_000)
    at = 44_000
    samples[at : at + 8] = 5.0
    bins = filled(samples, [])
    stop = at + 100 + shift
    trace = bins.trace(0, stop - span - shift, stop, pixels)
    peak = trace.index[np.argmax(trace.values)]
    width = BIN * -(-(-(-(span + shift) // BIN) + 1) // pixels)
    assert trace.values.max() == 5.0
    assert at - width <= peak <= at + 8
    # merged bins begin at multiples of their width, whatever the view: the place does not depend on `shift`
    again = bins.trace(0, stop - span - shift, stop + 1, pixels)
    assert again.values.max() == 5.0


def test_what_went_by_unseen_is_a_gap() -> None:
    bins = Bins(RATE)
    bins.add(0, np.ones((2, 1000)))
    bins.add(64_000, np.ones((2, 1000)))
    assert bins.n_missed == 63_000
    trace = bins.trace(0, 0, 65_000, 2000)
    assert np.isnan(trace.values[len(trace.values) // 2])
    assert trace.values[0] == trace.values[-1] == 1.0


def test_the_oldest_is_overwritten_and_nothing_grows() -> None:
    bins = Bins(RATE, seconds=2.0)
    for start in range(0, 80_000, 400):
        bins.add(start, np.full((2, 400), start, dtype=float))
    assert bins.first_sample >= 80_000 - 2 * RATE - BIN
    trace = bins.trace(0, 0, 80_000, 10_000)
    assert trace.index[0] == bins.first_sample
    assert trace.values.max() == 79_600


@given(n=st.integers(1, 4000), start=st.integers(0, 10**6), most=st.integers(1, 500))
def test_single_samples_are_merged_in_the_same_way(n: int, start: int, most: int) -> None:
    values = np.random.default_rng(n).standard_normal(n)
    trace = fine_trace(start, values, most)
    assert trace.values.max() == values.max()
    assert trace.values.min() == values.min()
    assert trace.index[0] >= start
    assert trace.index[-1] < start + n
