"""A rhythm that goes with an overtone of a slower one is that one's, and what no trial has is nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import ENOUGH_ONCE
from analysis.mismatch.model.effects import OwnShapes
from analysis.mismatch.name.phases import ahead_alike
from analysis.mismatch.name.weighing import is_nothing
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial

BREATH_HZ = 0.38
TIME_S = np.arange(0.0, 8.0, 0.01)
HOLD = TIME_S > 1.5


def _study(number: int, *, locked: bool, seed: int) -> StudyFit:
    """Return 20 trials of a breath whose rate wanders, and of a rhythm near its overtone, as they were found."""
    random = np.random.default_rng(seed)
    trial = SimpleNamespace(time_s=TIME_S, widths_s=np.full(len(TIME_S), 0.01), in_phase=lambda *_: HOLD)
    states = []
    for _ in range(20):
        wanders = 0.06 * np.interp(TIME_S, np.linspace(0.0, 8.0, 5), random.standard_normal(5))
        phase = random.uniform(0.0, 2 * np.pi) + 2 * np.pi * np.cumsum(BREATH_HZ * (1.0 + wanders)) * 0.01
        ahead = 0.9 if locked else random.uniform(0.0, 2 * np.pi)
        rhythms = [
            SimpleNamespace(effect=name, frequency_hz=k * BREATH_HZ, found_mm=np.cos(k * phase + shift))
            for name, k, shift in (("respiration", 1, 0.0), ("heartbeat", number, ahead))
        ]
        states.append(SimpleNamespace(shapes=OwnShapes(), rhythms=rhythms, coefficients=np.zeros(0)))
    return cast(StudyFit, SimpleNamespace(trials=[trial] * 20, states=states))


@pytest.mark.parametrize("number", [2, 3])
@pytest.mark.parametrize("locked", [True, False])
def test_what_goes_with_an_overtone_is_known_by_its_phase(number: int, locked: bool) -> None:
    """Phases that are as much alike by chance come once in 5000 studies; these are drawn once, by a fixed seed."""
    fit = _study(number, locked=locked, seed=5)
    assert (ahead_alike(fit, "heartbeat", "respiration") > ENOUGH_ONCE) is locked
    assert ahead_alike(fit, "respiration", "heartbeat") == 0.0


def test_what_no_trial_has_is_nothing(record: Callable[..., list[Trial]]) -> None:
    """A shift was looked for once more and found in no trial: it stood as named, and had no size to be told."""
    fit = fit_baseline(take_in_memory(record(51)[:1]).trials)
    account = Account(fit, steps={"motion_artefact": 0.0})
    assert is_nothing(account, "motion_artefact")
    assert not is_nothing(replace(account, steps={}), "motion_artefact")
