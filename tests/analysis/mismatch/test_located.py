"""Where trials differ: what of a window's force is beyond the noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.locate.located import locate
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial

NOISY = "[noise]\nforce_mn_rms = 0.5\n"


@pytest.mark.parametrize("size_mn", [0.0, 0.6], ids=["nothing", "a wave in the retract"])
def test_a_window_tells_of_force_beyond_the_noise(record: Callable[..., list[Trial]], size_mn: float) -> None:
    """By itself noise of half a millinewton had been told as an eighth of a millinewton that differs."""
    fit = fit_baseline(take_in_memory(record(61, NOISY)).trials)
    trials = []
    for j, trial in enumerate(fit.trials):
        wave = np.sin(2.0 * np.pi * 200.0 * trial.time_s + j) * trial.in_phase("retract")
        trials.append(replace(trial, force_mn=trial.force_mn + size_mn * wave))
    found = locate(replace(fit, trials=tuple(trials)).with_states(), np.random.default_rng(0), somewhere=True)
    # as far as six hundred cells of noise tell: 0.5 mN / (2 * 600)^(1/4) is 0.085
    assert found[0].rms_mn == pytest.approx(size_mn / np.sqrt(2.0), abs=0.1)
    assert not size_mn or found[0].phase == "retract"
