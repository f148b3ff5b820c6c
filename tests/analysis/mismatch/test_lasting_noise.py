"""Noise of a position that lasts for many samples: it looks like motion, and no skin has felt it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.mismatch.diagnosis import diagnose
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.position_noise import freed_of_position_noise
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.model.effects import simulate
from analysis.mismatch.study.intake import Intake, take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.cells import CellTrial
from sim_hardware.concealment.offline import study_plans

WANDERS_MM, LASTS_S = 4e-4, 0.012


def _wandering(trial: Trial, seed: int) -> Trial:
    """Return a trial whose position wanders, as behind a slow filter, wherever the arm is."""
    shared = np.exp(-1.0 / (LASTS_S * trial.sample_rate_hz))
    white = np.random.default_rng(seed).standard_normal(trial.n_samples + 4000)
    wandering_mm = WANDERS_MM * np.sqrt(1.0 - shared**2) * lfilter([1.0], [1.0, -shared], white)[4000:]
    return replace(trial, position_v=trial.position_v + trial.calibration.volts_per_mm * wandering_mm)


@pytest.fixture(scope="module")
def quiet(record: Callable[..., list[Trial]]) -> list[Trial]:
    """A study whose position has white noise only."""
    return record(99, "", study_plans(depths_mm=(0.3, 0.7), repeats=3, hold_s=2.0, dwell_s=0.4))


@pytest.fixture(scope="module")
def wandering(quiet: list[Trial]) -> Intake:
    """The same study, its position wandering in every trial anew."""
    return take_in_memory([_wandering(trial, seed) for seed, trial in enumerate(quiet)])


@pytest.fixture(scope="module")
def freed(wandering: Intake) -> StudyFit:
    """Its baseline."""
    return fit_baseline(wandering.trials)


def _off_mm(trials: tuple[CellTrial, ...], exact: tuple[CellTrial, ...]) -> float:
    """Return how far positions in the hold are from where the arm was, rms, whatever each trial's own zero is."""
    off = []
    for trial, there in zip(trials, exact, strict=True):
        hold = trial.in_phase("hold")
        at_mm = np.interp(trial.time_s[hold], there.time_s, there.position_mm)
        off.append(float(np.std(trial.position_mm[hold] - at_mm)))
    return float(np.sqrt(np.mean(np.square(off))))


def test_a_position_goes_without_noise_that_no_force_follows(
    quiet: list[Trial], wandering: Intake, freed: StudyFit
) -> None:
    """Its smoothing may reach over a fiftieth of the recording: that leaves a third of what lasts for 12 ms."""
    exact = take_in_memory(quiet).trials
    assert _off_mm(wandering.trials, exact) > 0.75 * WANDERS_MM
    assert _off_mm(freed.trials, exact) < 0.45 * WANDERS_MM


def test_nothing_is_named_for_noise_of_a_position(wandering: Intake) -> None:
    """What it has beside a servo's answer was called unfollowed motion, and its smoothed part a dashpot and a lag."""
    found = diagnose(wandering)
    assert found.improved.names == ()
    assert not found.remainder.significant


def test_what_the_arm_did_stays_in_its_position(freed: StudyFit, wandering: Intake) -> None:
    """The same motion, and a skin that felt it."""
    felt = []
    for trial, calmer, state in zip(wandering.trials, freed.trials, freed.states, strict=True):
        change_mn = simulate(trial, state, freed.shared) - simulate(calmer, state, freed.shared)
        full_mn = (trial.full_force_mn + trial.at_samples(change_mn)).astype(np.float32)
        felt.append(replace(trial, force_mn=trial.force_mn + change_mn, full_force_mn=full_mn))
    assert fit_baseline(felt).trials == tuple(felt)


def test_white_noise_of_a_position_is_no_noise_that_lasts(quiet: list[Trial]) -> None:
    fit = fit_baseline(take_in_memory(quiet).trials)
    assert freed_of_position_noise(fit) is fit
