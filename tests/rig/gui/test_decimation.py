from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rig.gui.jobs.decimation import extremes


@given(st.integers(1, 5000), st.integers(1, 300), st.data())
def test_no_spike_of_a_single_sample_is_lost(n: int, bins: int, data: st.DataObject) -> None:
    start = data.draw(st.integers(0, n - 1))
    stop = data.draw(st.integers(start + 1, n))
    spike = data.draw(st.integers(start, stop - 1))
    values = np.sin(np.arange(n) / 7).astype(np.float32)
    values[spike] = data.draw(st.sampled_from([-9.0, 9.0]))
    at = extremes(values, bins, start, stop)
    assert spike in at
    assert len(at) <= 2 * bins + 4
    assert np.all(np.diff(at) > 0)
    assert start <= at[0]
    assert at[-1] < stop


def test_a_moving_view_leaves_every_spike_where_it_is() -> None:
    values = np.zeros(100_000, dtype=np.float32)
    spikes = np.arange(500, 99_000, 4321)
    values[spikes] = 1.0
    for start in range(0, 200, 7):
        at = extremes(values, 600, start, start + 80_000)
        inside = spikes[(spikes >= start) & (spikes < start + 80_000)]
        assert set(inside) <= set(at[values[at] > 0])


def test_nothing_to_show() -> None:
    assert len(extremes(np.zeros(0), 10)) == 0
    assert len(extremes(np.zeros(10), 10, 5, 5)) == 0
