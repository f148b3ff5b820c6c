"""An arm that swings: its angle is zero at mid travel, or a little beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import library

ARC = library()["lever_arc"]


@pytest.mark.parametrize("zero_mm", [-0.6, 0.0, 0.2])
def test_an_arm_that_is_mounted_askew_is_one_that_stands_elsewhere(trial: CellTrial, zero_mm: float) -> None:
    askew = {"radius_mm": 9.0, "zero_mm": zero_mm}
    elsewhere = replace(trial, position_mm=trial.position_mm - zero_mm)
    straight, force_mn = {"radius_mm": 9.0, "zero_mm": 0.0}, np.full(len(trial.time_s), 50.0)
    tip_mm = ARC.tip_mm(trial, trial.position_mm, force_mn, askew)
    np.testing.assert_allclose(
        tip_mm - zero_mm, ARC.tip_mm(elsewhere, elsewhere.position_mm, force_mn, straight)
    )
    read = ARC.sensor_force_mn(trial, force_mn, askew)
    np.testing.assert_allclose(read, ARC.sensor_force_mn(elsewhere, force_mn, straight))
    # R sin(x / R) and F cos(x / R) at the zero itself
    at_zero = int(np.argmin(np.abs(trial.angle_travel_mm - zero_mm)))
    assert tip_mm[at_zero] == pytest.approx(trial.position_mm[at_zero], abs=1e-3)
