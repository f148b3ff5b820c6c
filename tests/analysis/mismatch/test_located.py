"""Where trials differ: what of a window's force is beyond the noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.locate.located import locate, with_bursts
from analysis.mismatch.locate.transients import NO_BURSTS, find_bursts
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial

NOISY = "[noise]\nforce_mn_rms = 0.5\n"
BURST_MN, BURST_SAMPLES = 5.0, 16


def _with_bursts(fit: StudyFit) -> StudyFit:
    """Return the fit to trials that each hold a burst in the middle of their hold."""
    trials = []
    for trial in fit.trials:
        first, last = np.flatnonzero(np.repeat(trial.in_phase("hold"), trial.counts.astype(int)))[[0, -1]]
        force_mn = trial.full_force_mn.copy()
        force_mn[(first + last) // 2 :][:BURST_SAMPLES] += BURST_MN
        trials.append(replace(trial, full_force_mn=force_mn))
    return replace(fit, trials=tuple(trials))


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


def test_a_burst_has_its_share_beside_what_lasts(record: Callable[..., list[Trial]]) -> None:
    """A spark of milliseconds had been told as all of the mismatch, beside a ramp that was nine tenths of it."""
    fit = _with_bursts(fit_baseline(take_in_memory(record(61, NOISY)).trials))
    bursts = find_bursts(fit)
    assert bursts.phase == "hold"
    # a sample counts no more than three deviations, and noise alone would have half of the least found here
    clipped = len(fit.trials) * BURST_SAMPLES * (3.0 * 0.5) ** 2
    assert 0.6 * clipped < bursts.energy < 1.2 * clipped
    (alone,) = with_bursts((), bursts)
    assert alone.share == 1.0
    lasting = replace(alone, phase="ramp", share=0.8, energy=0.8 * 9.0 * bursts.energy)
    other = replace(alone, phase="retract", share=0.2, energy=0.2 * 9.0 * bursts.energy)
    found = with_bursts((lasting, other), bursts)
    assert [w.phase for w in found] == ["ramp", "retract", "hold"]
    assert [w.share for w in found] == pytest.approx([0.72, 0.18, 0.1])
    assert with_bursts((lasting, other), NO_BURSTS) == (lasting, other)
