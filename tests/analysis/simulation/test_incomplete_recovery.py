"""What the tissue has not forgotten of the indentation before."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.mismatch.study.intake import take_in_memory
from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import PerTrial, simulate_force
from analysis.simulation.mechanism import Tissue, library

sys.path.append(str(Path(__file__).parents[2]))
from bench_trials import bench_trials

from sim_hardware.concealment.offline import study_plans

TISSUE = Tissue(120.0, 44.5, 2.279, 35.3, 0.149)


@pytest.fixture(scope="module")
def trials() -> tuple[CellTrial, ...]:
    plans = study_plans(depths_mm=(0.3, 0.5), repeats=2)
    return take_in_memory(bench_trials("seed = 3\n[specimens]\npublished_tissue = true\n", plans)).trials


def test_a_trial_knows_how_deep_the_one_before_went_and_how_long_ago(trials: tuple[CellTrial, ...]) -> None:
    assert trials[0].pressed_before is None
    for before, trial in zip(trials[:-1], trials[1:], strict=True):
        assert trial.pressed_before is not None
        depth_mm, rest_s = trial.pressed_before
        assert depth_mm == pytest.approx(before.depth_mm)
        assert rest_s > 0.0


@given(fraction=st.floats(0.01, 0.2), T=st.floats(1.0, 300.0), rest_s=st.floats(1.0, 200.0))
@settings(max_examples=40, deadline=None)
def test_force_lacks_what_is_left_of_the_load_and_no_more_than_there_is(
    trials: tuple[CellTrial, ...], fraction: float, T: float, rest_s: float
) -> None:
    trial = replace(trials[1], pressed_before=(0.4, rest_s))
    own, law = PerTrial(trial.z0_start_mm, 0.0), library()["incomplete_recovery"]
    plain = simulate_force(trial, TISSUE, own)
    lacking = simulate_force(trial, TISSUE, own, [(law, {"fraction": fraction, "time_constant_s": T})])
    load_mn = fraction * TISSUE.k0 * 0.4 * np.exp(-(rest_s + trial.time_s) / T)
    np.testing.assert_allclose(lacking, np.maximum(plain - load_mn, 0.0), atol=1e-9)


def test_a_dimple_is_a_surface_that_lies_lower_and_fills(trials: tuple[CellTrial, ...]) -> None:
    trial = replace(trials[1], pressed_before=(0.4, 5.0))
    own, law = PerTrial(trial.z0_start_mm, 0.0), library()["incomplete_recovery"]
    values = {"fraction": 0.1, "time_constant_s": 10.0, "dimple": 1.0}
    lower_mm = 0.1 * 0.4 * np.exp(-(5.0 + trial.time_s) / 10.0)
    in_a_dimple = simulate_force(trial, TISSUE, own, [(law, values)])
    np.testing.assert_allclose(
        in_a_dimple, simulate_force(trial, TISSUE, own, surface_mm=-lower_mm), atol=1e-9
    )


def test_what_is_lacked_within_a_reach_is_lacked_beyond_it(trials: tuple[CellTrial, ...]) -> None:
    trial = replace(trials[1], pressed_before=(0.4, 5.0))
    own, law = PerTrial(trial.z0_start_mm, 0.0), library()["incomplete_recovery"]
    values = {"fraction": 0.1, "time_constant_s": 1000.0}
    at_once, later = (
        simulate_force(trial, TISSUE, own, [(law, {**values, "reach": reach})]) for reach in (1e-4, 0.02)
    )
    touched = np.flatnonzero(later > 0.0)
    begins, pressed = touched[0], trial.in_phase("hold")
    assert later[begins] > at_once[begins]
    np.testing.assert_allclose(later[pressed], at_once[pressed], atol=1e-6)
