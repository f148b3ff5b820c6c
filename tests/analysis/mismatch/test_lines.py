"""A tone is in every trial."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.name.lines import find_lines
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial

HZ, AMPLITUDE_MN = 3604.0, 0.02


@pytest.fixture(scope="module")
def fit(record: Callable[..., list[Trial]]) -> StudyFit:
    return fit_baseline(take_in_memory(record(47)).trials)


def _with_tone(fit: StudyFit, where: int, amplitude_mn: float = AMPLITUDE_MN) -> StudyFit:
    """Return the fit to recordings of which the first ``where`` have a tone, its phase new in each."""
    trials = list(fit.trials)
    for j in range(where):
        tone = amplitude_mn * np.sin(2 * np.pi * HZ * trials[j].full_time_s + j)
        trials[j] = replace(trials[j], full_force_mn=trials[j].full_force_mn + tone.astype(np.float32))
    return replace(fit, trials=tuple(trials))


def test_a_tone_of_all_trials_is_found(fit: StudyFit) -> None:
    (line,) = find_lines(_with_tone(fit, len(fit.trials)))
    assert line.frequency_hz == pytest.approx(HZ, abs=0.5)
    assert line.amplitude_mn == pytest.approx(AMPLITUDE_MN, rel=0.1)
    assert line.name == ""


@pytest.mark.parametrize("where", [0, 1])
def test_what_one_trial_alone_has_is_no_tone(fit: StudyFit, where: int) -> None:
    """By chance a line is found once in a million studies."""
    assert find_lines(_with_tone(fit, where, 5.0 * AMPLITUDE_MN)) == []


@pytest.mark.parametrize("of_position", [True, False])
def test_a_hum_is_the_force_s_where_the_motion_does_not_make_it(fit: StudyFit, of_position: bool) -> None:
    """A hum of the position's sensor, where the simulation follows it, is one that the force lacks."""
    trials = []
    for j, trial in enumerate(fit.trials):
        if of_position:
            hum_mm = 2e-4 * np.sin(2 * np.pi * 50.0 * trial.time_s + j)
            trials.append(replace(trial, position_mm=trial.position_mm + hum_mm))
        else:
            hum_mn = 0.05 * np.sin(2 * np.pi * 50.0 * trial.full_time_s + j)
            full_mn = trial.full_force_mn + hum_mn.astype(np.float32)
            trials.append(replace(trial, full_force_mn=full_mn))
    (line,) = find_lines(replace(fit, trials=tuple(trials)))
    assert line.frequency_hz == pytest.approx(50.0, abs=0.5)
    assert line.name == ("" if of_position else "mains_hum")
