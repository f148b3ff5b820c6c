"""A drift of the force reading: straight as in the textbook, or settling as what warms does."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import library

DRIFT = library()["force_drift"]


@pytest.mark.parametrize("bends_per_s", [-0.05, 0.0, 1e-7, 0.05, 0.2])
def test_the_rate_is_the_mean_over_ten_seconds(trial: CellTrial, bends_per_s: float) -> None:
    read = DRIFT.sensor_force_mn(
        trial, np.zeros_like(trial.time_s), {"rate_mn_per_s": 0.2, "bends_per_s": bends_per_s}
    )
    assert np.interp(10.0, trial.time_s, read) == pytest.approx(2.0, rel=1e-3)
    slope = np.diff(read) / np.diff(trial.time_s)
    # dF/dt falls by exp(-b t)
    expected = slope[0] * np.exp(-bends_per_s * (trial.time_s[-1] - trial.time_s[0]))
    assert slope[-1] == pytest.approx(expected, rel=0.01)
