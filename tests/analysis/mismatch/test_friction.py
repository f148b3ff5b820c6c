"""Dry friction: how it begins, what of it stays at rest, and how much more of it there is at creeping speed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares

from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import library
from analysis.simulation.motion import estimate_motion
from analysis.simulation.reduction import reduce_trial
from sim_hardware.concealment.offline import study_plans
from sim_hardware.effects.coulomb_friction import CoulombFriction
from sim_hardware.parts import Block

FRICTION = library()["coulomb_friction"]
HELD = {"longer": 1.0, "bend": 0.004, "held": 1.0}
PLANS: dict[str, Any] = {"depths_mm": (0.5,), "repeats": 1, "hold_s": 7.0, "dwell_s": 0.5}


@pytest.fixture(scope="module")
def trial(record: Callable[..., list[Trial]]) -> CellTrial:
    return take_in_memory(record(48, plans=study_plans(**PLANS))).trials[0]


def felt(trial: CellTrial, **law: float) -> NDArray[np.float64]:
    values = {**FRICTION.null, "force_mn": 2.0, **law}
    return FRICTION.sensor_force_mn(trial, np.zeros_like(trial.time_s), values)


@pytest.mark.parametrize(("held", "left"), [(0.01, 0.0), (0.999, 0.8), (1.0, 1.0)])
def test_friction_at_rest_is_let_go_by_and_by_or_held(trial: CellTrial, held: float, left: float) -> None:
    at_the_end = np.flatnonzero(trial.in_phase("hold"))[-10:]
    # the noise of a position is no motion that bends bristles
    assert felt(trial, **{**HELD, "held": held})[at_the_end] == pytest.approx(2.0 * left, abs=0.02)


def test_what_slides_slowly_is_held_by_more_than_what_slides_quickly(trial: CellTrial) -> None:
    stops = np.flatnonzero(trial.in_phase("hold"))[5]
    ramps = np.flatnonzero(trial.in_phase("ramp"))[-20]
    more = felt(trial, **{**HELD, "creeping": 0.3, "creeping_mm_s": 1.0})
    assert more[ramps] == pytest.approx(2.0, rel=0.01)
    assert more[stops] > 2.01


def test_a_bearing_whose_friction_begins_and_ends_gradually_is_within_the_law(
    record: Callable[..., list[Trial]],
) -> None:
    """Half of the bench's friction begins and ends at once, half by and by: nothing is left for another law."""
    (recorded,) = record(48, plans=study_plans(**PLANS))
    motion = estimate_motion(recorded)
    trial = reduce_trial(recorded, motion)
    still = np.zeros(recorded.n_samples)
    speed_mm_s = np.where(np.abs(motion.velocity_mm_s) > 0.01, motion.velocity_mm_s, 0.0)
    block = Block(
        time_s=recorded.time_s,
        trial_time_s=recorded.time_s,
        step_s=1.0 / recorded.sample_rate_hz,
        substeps=1,
        touched_s=np.inf,
        skin=True,
        command_mm=still,
        fine_position_mm=motion.position_mm,
        fine_velocity_mm_s=speed_mm_s,
        fine_acceleration_mm_s2=still,
    )
    bearing = CoulombFriction({"force_mn": 2.0, "presliding_um": 1.8, "stribeck": 0.1, "rough": 0.5})
    added_mn = np.add.reduceat(bearing.sense_fine(block, still), trial.starts) / trial.counts
    weights = np.sqrt(trial.counts)
    free = [p for p in FRICTION.parameters if p.inner]
    typical = {**FRICTION.typical, "longer": 0.5}

    def left_mn(x: NDArray[np.float64]) -> NDArray[np.float64]:
        values = {p.name: p.from_fit(float(v)) for p, v in zip(free, x, strict=True)}
        return np.asarray((felt(trial, **values) - added_mn) * weights)

    start = np.array([p.to_fit(typical[p.name]) for p in free])
    found = least_squares(left_mn, start, bounds=np.array([p.ends for p in free]).T, diff_step=1e-3)
    assert np.linalg.norm(found.fun) < 0.02 * np.linalg.norm(added_mn * weights)


def test_bristles_hold_what_the_motion_before_the_trial_left(trial: CellTrial) -> None:
    left = felt(trial, **{**HELD, "before": -0.8})
    assert left[0] == pytest.approx(-1.6, rel=0.02)
    # once they have slid, nothing tells what they held
    moved = trial.in_phase("hold")
    np.testing.assert_allclose(left[moved], felt(trial, **HELD)[moved], atol=1e-6)
