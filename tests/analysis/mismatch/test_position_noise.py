"""Noise of the position is a force in contact: what smoothing leaves of it is no evidence for an effect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.fit.noise import NoiseModel
from analysis.mismatch.fit.whitener import Whitener
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from analysis.simulation.cells import CellTrial
from sim_hardware.concealment.offline import TrialPlan, rigid_plan, study_plans

NOISY_MM = 8e-4
QUIET = "[noise]\nforce_mn_rms = 0.1\n"


def _noisy(trial: Trial, seed: int) -> Trial:
    """Return a trial without its command, with more noise of its position."""
    random = np.random.default_rng(seed)
    noise_v = NOISY_MM * abs(trial.calibration.volts_per_mm) * random.standard_normal(trial.n_samples)
    return replace(trial, position_v=trial.position_v + noise_v, command_v=None)


def _noisier_by(record: Callable[..., list[Trial]], plan: TrialPlan) -> tuple[CellTrial, np.ndarray]:
    """Return a noisy trial in cells, and how far its contact's force is off for its position (n,), mN."""
    (quiet,) = record(96, QUIET, [plan])
    noisy = take_in_memory([_noisy(quiet, 0)]).trials[0]
    exact = take_in_memory([quiet]).trials[0]
    off_mm = noisy.position_mm - np.interp(noisy.time_s, exact.time_s, exact.position_mm)
    stiffness = float(np.ptp(noisy.force_mn)) / noisy.depth_mm
    if noisy.kind == "rigid_target":
        stiffness = noisy.target_stiffness_mn_per_mm or 0.0
    return noisy, stiffness * off_mm


@pytest.mark.parametrize(
    "plan",
    [rigid_plan(), study_plans(depths_mm=(0.5,), repeats=1, hold_s=2.0, dwell_s=0.4)[0]],
    ids=["a block", "skin"],
)
def test_a_force_is_as_far_off_as_its_position_was_told(
    record: Callable[..., list[Trial]], plan: TrialPlan
) -> None:
    """It lasts some 20 ms: a hold of 2 s tells it to a tenth, and widths are chosen by these samples."""
    noisy, off_mn = _noisier_by(record, plan)
    told_mn = np.sqrt(np.sum([f**2 for f, _ in noisy.by_position], axis=0))
    inside = noisy.in_phase("hold") & (noisy.time_s > noisy.hold_window_s[0] + 0.1)
    inside &= noisy.time_s < noisy.hold_window_s[1] - 0.1
    off = float(np.std(off_mn[inside])) / float(np.sqrt(np.mean(told_mn[inside] ** 2)))
    assert 0.6 < off < 1.6


def test_cells_are_weighed_by_what_their_position_leaves_open(record: Callable[..., list[Trial]]) -> None:
    (quiet,) = record(96, QUIET, [rigid_plan(hold_s=0.5)])
    noisy = take_in_memory([_noisy(quiet, 0)]).trials[0]
    noise = NoiseModel(0.1)
    lag_s = np.abs(noisy.time_s[:, None] - noisy.time_s)
    expected = np.diag(noise.white_mn**2 / noisy.counts)
    assert len(noisy.by_position) > 1
    for f, lasts_s in noisy.by_position:
        expected += np.outer(f, f) * np.exp(-lag_s / lasts_s)
    white = Whitener(noisy, noise)(np.eye(len(noisy.time_s)))
    # a millinewton squared here; cells whose term is below a tenth of the white noise do without it
    np.testing.assert_allclose(np.linalg.inv(white.T @ white), expected, atol=2e-3)
    blind = Whitener(replace(noisy, position_error_mm=None), noise)
    assert float(np.sum(blind(noisy.force_mn) ** 2)) > float(np.sum((white @ noisy.force_mn) ** 2))
