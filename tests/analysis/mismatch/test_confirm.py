"""Confirmation: what of a sample is noise, whatever differs beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.confirm.heldout import noise_floor_mn
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial

NOISE_MN = 0.2


@pytest.mark.parametrize("size_mn", [0.0, 2.0], ids=["nothing", "a wave in the retract"])
def test_the_noise_floor_is_a_samples_noise_whatever_a_short_motion_leaves(
    record: Callable[..., list[Trial]], size_mn: float
) -> None:
    """Chi2 a cell had stood for that a sample: a motion has the most cells, and the fewest samples."""
    fit = fit_baseline(take_in_memory(record(61, f"[noise]\nforce_mn_rms = {NOISE_MN}\n")).trials)
    trials = []
    for j, trial in enumerate(fit.trials):
        wave_mn = size_mn * np.sin(2.0 * np.pi * 200.0 * trial.time_s + j) * trial.in_phase("retract")
        full_mn = trial.full_force_mn + np.repeat(wave_mn, trial.counts.astype(int)).astype(np.float32)
        trials.append(replace(trial, force_mn=trial.force_mn + wave_mn, full_force_mn=full_mn))
    waving = replace(fit, trials=tuple(trials)).with_states()
    left = np.concatenate([waving.full_residual_mn(j) for j in range(len(trials))])
    assert float(np.std(left)) > NOISE_MN * (1.5 if size_mn else 0.98)
    assert noise_floor_mn(waving) == pytest.approx(NOISE_MN, rel=0.02)
