"""Dry friction at rest: it is let go at once, or carried through the whole hold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.mechanism import library
from sim_hardware.concealment.offline import study_plans


@pytest.mark.parametrize("carried", [0.0, 0.4, 1.0])
def test_friction_at_rest_is_let_go_or_carried(record: Callable[..., list[Trial]], carried: float) -> None:
    trial = take_in_memory(record(48, plans=study_plans(depths_mm=(0.5,), repeats=1))).trials[0]
    law = {"force_mn": 2.0, "bristle": 0.02, "fade_ms": 1.0, "carried": carried}
    felt = library()["coulomb_friction"].sensor_force_mn(trial, np.zeros_like(trial.time_s), law)
    at_the_end = np.flatnonzero(trial.in_phase("hold"))[-10:]
    # the arm never quite rests: what is known of its motion bends the bristles a little
    assert felt[at_the_end] == pytest.approx(2.0 * carried, abs=0.2)
