"""A converter whose levels lie further apart than noise goes: what rounding does to means passes for no noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.noise import NoiseModel
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.locate.quiet import out_of_contact
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.cells import CellTrial
from sim_hardware.concealment.offline import study_plans

LEVEL_MN = 0.33
NOISE = "[noise]\nforce_mn_rms = 0.075\n"
BLOCK = 64
"""Samples of which means are taken."""


def _rounded(trial: Trial, level_mn: float = LEVEL_MN) -> Trial:
    level_v = level_mn * abs(trial.calibration.volts_per_mn)
    return replace(trial, force_v=level_v * np.round(trial.force_v / level_v))


@pytest.fixture(scope="module")
def trials(record: Callable[..., list[Trial]]) -> Sequence[CellTrial]:
    plans = study_plans(depths_mm=(0.3, 0.7), repeats=2, hold_s=4.0, dwell_s=0.4)
    return take_in_memory([_rounded(t) for t in record(94, NOISE, plans)]).trials


def _beyond_white(fit: StudyFit, of: Callable[[int], np.ndarray]) -> float:
    """Return how much larger means of many samples at rest are than those of white noise, squared."""
    means, samples = [], []
    for j, trial in enumerate(fit.trials):
        held = np.repeat(
            trial.in_phase("hold") & (trial.time_s > trial.hold_window_s[0] + 0.2), _counts(trial)
        )
        left = of(j)[held]
        left = left[: len(left) // BLOCK * BLOCK].reshape(-1, BLOCK)
        means.append(left.mean(axis=1) - left.mean())
        samples.append(left.ravel())
    return BLOCK * float(np.var(np.concatenate(means)) / np.var(np.concatenate(samples)))


def _counts(trial: CellTrial) -> np.ndarray:
    return trial.counts.astype(np.int64)


def test_means_of_rounded_samples_are_those_of_noise(trials: Sequence[CellTrial]) -> None:
    assert all(t.levels is not None for t in trials)
    blind = [replace(t, levels=None) for t in trials]
    as_read = [replace(t, force_mn=t.cell_means(t.full_force_mn.astype(np.float64))) for t in blind]
    known, unknown = fit_baseline(trials), fit_baseline(as_read)
    # 1900 means scatter by 3 % of their variance
    assert _beyond_white(known, known.full_residual_mn) < 1.5
    assert _beyond_white(known, known.unrounded_residual_mn) < 1.3
    assert _beyond_white(unknown, unknown.full_residual_mn) > 2.0


def test_a_reading_that_hardly_ever_leaves_its_level_is_no_quiet_sensor(
    record: Callable[..., list[Trial]],
) -> None:
    """Out of contact it comes again and again, and in a hold it goes from level to level: 380 nats had spoken for what
    wanders in contact alone.
    """
    plans = study_plans(depths_mm=(0.3,), repeats=3, hold_s=1.0, dwell_s=0.4)
    recorded = record(95, "[noise]\nforce_mn_rms = 0.26\n", plans)
    wanders = NoiseModel(0.26, ((0.05, 0.0064),))
    for level_mn in (0.01, 1.8):
        fit = fit_baseline(take_in_memory([_rounded(t, level_mn) for t in recorded]).trials)
        assert (out_of_contact(fit.weighed_by(wanders)).gain > 0.0) == (level_mn < 0.1)
