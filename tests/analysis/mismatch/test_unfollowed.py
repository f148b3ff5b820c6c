"""Motion that was recorded and that the skin never felt: a position misread, and one that is right."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.mismatch.diagnose import diagnose_paths
from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import ENOUGH_SHARED
from analysis.mismatch.model.dictionary import templates
from analysis.mismatch.model.effects import simulate
from analysis.mismatch.model.unfollowed import UNFOLLOWED
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.mechanism import library
from sim_hardware.concealment.offline import study_plans

RIPPLE_MM, PERIOD_MM = 0.004, 0.3


def _rippled(trial: Trial, phase: float) -> Trial:
    """Return a trial whose position is read through a gear that is not round."""
    ripple_mm = RIPPLE_MM * np.sin(2 * np.pi * trial.position_mm / PERIOD_MM + phase)
    return replace(trial, position_v=trial.position_v + trial.calibration.volts_per_mm * ripple_mm)


@pytest.fixture(scope="module")
def recorded(record: Callable[..., list[Trial]]) -> list[Trial]:
    """A study whose position was misread, in each trial from elsewhere on."""
    plans = study_plans(depths_mm=(0.3, 0.7), repeats=3, hold_s=2.0, dwell_s=0.4)
    phases = np.random.default_rng(51).uniform(0.0, 2 * np.pi, len(plans))
    trials = record(97, "", plans)
    return [_rippled(t, float(p)) for t, p in zip(trials, phases, strict=True)]


@pytest.fixture(scope="module")
def misread(recorded: list[Trial]) -> StudyFit:
    """Its baseline."""
    return fit_baseline(take_in_memory(recorded).trials)


def _with_unfollowed(fit: StudyFit) -> Account:
    """Return the account of a fit with the law that is looked for."""
    (template,) = (t for t in templates(fit.trials) if t.name == UNFOLLOWED.name)
    return Account(fit).with_laws((template.as_law(1.0),)).weighed_anew()


def test_what_was_misread_the_force_does_not_follow(misread: StudyFit) -> None:
    """All of it: a share of 1, less what of it is no more than the position's noise."""
    found = _with_unfollowed(misread)
    assert found.gain_over(Account(misread))[0] > 100.0 * ENOUGH_SHARED
    assert found.fit.shared.laws[0].values["share"] == pytest.approx(1.0, abs=0.15)


def test_a_position_that_errs_is_told_in_words_and_no_law_takes_its_place(
    recorded: list[Trial], as_files: Callable[[Path, Sequence[Trial]], Path], tmp_path: Path
) -> None:
    """A dashpot and a lag smooth what the position has and the force has not; they were named in its place."""
    page = diagnose_paths([as_files(tmp_path / "trials", recorded)], out=tmp_path / "out")
    report = json.loads((page.parent / "report.json").read_text(encoding="utf-8"))
    assert (report["verdict"], report["mechanisms"]) == ("unknown", [])
    assert f"no mechanism of the library explains it: {UNFOLLOWED.words}." in report["summary"]


def test_what_the_arm_did_the_force_follows(misread: StudyFit) -> None:
    """The same motion, and a skin that felt it."""
    trials = []
    for trial, state in zip(misread.trials, misread.states, strict=True):
        beside_mm = trial.beside_servo_mm
        assert beside_mm is not None
        still = replace(trial, position_mm=trial.position_mm - beside_mm)
        felt_mn = simulate(trial, state, misread.shared) - simulate(still, state, misread.shared)
        full_mn = (trial.full_force_mn + trial.at_samples(felt_mn)).astype(np.float32)
        trials.append(replace(trial, force_mn=trial.force_mn + felt_mn, full_force_mn=full_mn))
    felt = fit_baseline(trials)
    found = _with_unfollowed(felt)
    assert found.gain_over(Account(felt))[0] < ENOUGH_SHARED
    assert found.fit.shared.laws[0].values["share"] == pytest.approx(0.0, abs=0.1)


def test_noise_of_a_position_is_no_motion_to_be_followed(record: Callable[..., list[Trial]]) -> None:
    """Nothing is looked for where a servo explains the position, and the library does not know of it."""
    plans = study_plans(depths_mm=(0.3,), repeats=2, hold_s=1.0, dwell_s=0.4)
    trials = take_in_memory(record(98, "", plans)).trials
    assert not any(UNFOLLOWED.applies(t) for t in trials)
    assert UNFOLLOWED.name not in {t.name for t in templates(trials)}
    assert UNFOLLOWED.name not in library()
