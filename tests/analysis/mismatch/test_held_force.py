"""A force whose instrument gives a new value less often than it is read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.mismatch.study.held_force import held_for, held_note, with_readings
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.motion import estimate_motion
from sim_hardware.concealment.offline import study_plans


@pytest.fixture(scope="module")
def recorded(record: Callable[..., list[Trial]]) -> list[Trial]:
    """Two trials, their force new in every sample."""
    return record(71, "", study_plans(depths_mm=(0.3,), repeats=2, hold_s=1.0, dwell_s=0.4))


def _held(trial: Trial, held: int, first: int, seed: int = 0) -> Trial:
    """Return a trial whose force is new at every so many samples, read by a converter with a little noise."""
    at = np.maximum((np.arange(trial.n_samples) - first) // held * held + first, 0)
    noise_v = 1e-4 * np.random.default_rng(seed).normal(size=trial.n_samples)
    return replace(trial, force_v=trial.force_v[at] + noise_v)


def test_a_force_that_is_new_in_every_sample_stays(recorded: list[Trial]) -> None:
    assert held_for(recorded) == 1
    motion = estimate_motion(recorded[0])
    assert with_readings(recorded[0], motion, 1) == (recorded[0], motion)
    assert held_note(1) == ()


@settings(deadline=None, max_examples=30)
@given(st.sampled_from(["normal", "t2.5", "walk", "levels", "hum"]), st.integers(0, 10**6))
def test_no_noise_is_taken_for_a_held_force(recorded: list[Trial], kind: str, seed: int) -> None:
    """Of 2000 draws the largest mean change at one place was 1.15 of the next largest; asked are 3."""
    random, n = np.random.default_rng(seed), 20_000
    force_v = {
        "normal": lambda: random.normal(size=n),
        "t2.5": lambda: random.standard_t(2.5, n),
        "walk": lambda: np.cumsum(random.normal(size=n)),
        "levels": lambda: np.round(random.normal(size=n) / 3.0),
        "hum": lambda: np.sin(2.0 * np.pi * 50.0 / 1000.0 * np.arange(n)),
    }[kind]()
    assert held_for([replace(recorded[0], force_v=force_v)]) == 1


@settings(deadline=None, max_examples=30)
@given(st.integers(2, 16), st.data())
def test_one_sample_is_kept_of_each_value(recorded: list[Trial], held: int, data: st.DataObject) -> None:
    first = data.draw(st.integers(0, held - 1))
    trial = _held(recorded[0], held, first)
    assert held_for([trial]) == held
    motion = estimate_motion(trial)
    read, moved = with_readings(trial, motion, held)
    assert moved.position_mm == pytest.approx(motion.position_mm[first::held])
    assert moved.shake_mm_s2.shape == (read.n_samples, 2)
    assert all(abs(first + k * held - motion.kinks).min() < held + first for k in moved.kinks.tolist())
    assert read.force_v == pytest.approx(recorded[0].force_v[first::held], abs=1e-3)
    assert read.position_v == pytest.approx(recorded[0].position_v[first::held])
    assert read.sample_rate_hz * held == pytest.approx(trial.sample_rate_hz)
    for before, after in zip(trial.phases, read.phases, strict=True):
        # the first that is kept of a phase is its first, or one of those right after
        assert 0 <= first + after.start * held - before.start < held + first
        assert after.stop <= read.n_samples


def test_what_is_held_in_some_trials_only_is_left_as_it_is(recorded: list[Trial]) -> None:
    assert held_for([_held(recorded[0], 4, 0), recorded[1]]) == 1


def test_a_study_says_that_its_force_is_held(recorded: list[Trial]) -> None:
    taken = take_in_memory([_held(t, 8, 3, k) for k, t in enumerate(recorded)])
    assert {t.sample_rate_hz for t in taken.trials} == {recorded[0].sample_rate_hz / 8}
    assert any("only once in 8 samples" in note for note in taken.notes)
