"""Rhythms of the body: none is steadier than it is, and what wanders is followed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from analysis.mismatch.name.oscillations import waves
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from sim_hardware.concealment.offline import study_plans


@pytest.mark.parametrize(
    ("middle_hz", "half", "cycles"),
    [(1.2, 0.03, 5.0), (7.0, 0.05, 5.0), (11.0, 0.05, 5.0), (7.0, 0.12, 2.5), (11.0, 0.12, 2.5)],
)
def test_a_rhythm_of_a_narrow_band_is_followed(
    record: Callable[..., list[Trial]], middle_hz: float, half: float, cycles: float
) -> None:
    """Twenty sines within 5 % of a tremor that is steady, 12 % of one that is not, 3 % of a pulse."""
    trials = record(45, plans=study_plans(depths_mm=(0.5,), repeats=1, hold_s=6.0, dwell_s=0.4))
    trial = take_in_memory(trials).trials[0]
    random = np.random.default_rng(46)
    hz = middle_hz * random.uniform(1 - half, 1 + half, 20)
    phases = 2 * np.pi * (np.multiply.outer(trial.time_s, hz) + random.uniform(size=20))
    blur = np.sinc(np.multiply.outer(trial.counts / trial.sample_rate_hz, hz))
    surface_mm = (np.cos(phases) * blur).sum(axis=1)
    columns = waves(trial, middle_hz, cycles=cycles).T
    left = surface_mm - columns @ np.linalg.lstsq(columns, surface_mm)[0]
    assert np.std(left) < 0.1 * np.std(surface_mm)
