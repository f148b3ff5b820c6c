"""Friction that grows with speed: at once as in the textbook, or a share of it by and by, as a grease does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import library

DRAG = library()["viscous_friction"]


def read(trial: CellTrial, elastic: float, settle_ms: float) -> np.ndarray:
    values = {"coefficient_mn_s_per_mm": 0.5, "elastic": elastic, "settle_ms": settle_ms}
    return np.asarray(DRAG.sensor_force_mn(trial, np.zeros_like(trial.time_s), values))


@given(elastic=st.floats(0.05, 1.0), settle_ms=st.floats(2.0, 50.0))
def test_a_grease_gives_and_bears_it_all_in_the_end(
    trial: CellTrial, elastic: float, settle_ms: float
) -> None:
    begun = trial.time_s > 0.5 * trial.time_s[-1]
    moved = replace(trial, velocity_mm_s=np.where(begun, 4.0, 0.0))
    force_mn, since_s = read(moved, elastic, settle_ms), moved.time_s - moved.time_s[begun][0]
    # c v (1 - s exp(-t / T)) after a step of the speed, which lasts from one cell to the next
    late = since_s > 0.1
    expected = 2.0 * (1.0 - elastic * np.exp(-1e3 * since_s[late] / settle_ms))
    np.testing.assert_allclose(force_mn[late], expected, atol=0.2 * elastic)
    assert force_mn[-1] == pytest.approx(2.0, rel=1e-3)
    assert force_mn[begun][0] < 2.0


def test_of_the_textbook_all_comes_at_once(trial: CellTrial) -> None:
    np.testing.assert_allclose(read(trial, 0.0, 5.0), 0.5 * trial.velocity_mm_s)
