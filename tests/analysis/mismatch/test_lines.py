"""A tone is in every trial."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.locate.remainder import remainder_of
from analysis.mismatch.name.lines import Tones, beside_tones, find_tones, spectra
from analysis.mismatch.name.sways import sways
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import PHASE_NAMES, Trial
from analysis.simulation.cells import CellTrial

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
    (line,) = find_tones(_with_tone(fit, len(fit.trials))).lines
    assert line.frequency_hz == pytest.approx(HZ, abs=0.5)
    assert line.amplitude_mn == pytest.approx(AMPLITUDE_MN, rel=0.1)
    assert line.name == ""


@pytest.mark.parametrize("where", [0, 1])
def test_what_one_trial_alone_has_is_no_tone(fit: StudyFit, where: int) -> None:
    """By chance a line is found once in a million studies."""
    assert find_tones(_with_tone(fit, where, 5.0 * AMPLITUDE_MN)) == Tones()


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
    (line,) = find_tones(replace(fit, trials=tuple(trials))).lines
    assert line.frequency_hz == pytest.approx(50.0, abs=0.5)
    assert line.name == ("" if of_position else "mains_hum")


def _swaying(
    random: np.random.Generator, time_s: np.ndarray, frequency_hz: float, kept_s: float
) -> np.ndarray:
    """Return a tone (n,) of unit rms that keeps its phase for a time."""
    kept = np.exp(-(time_s[1] - time_s[0]) / kept_s)
    drawn = (1.0, 1j) @ random.normal(size=(2, len(time_s))) * np.sqrt(1.0 - kept**2)
    first = (1.0, 1j) @ random.normal(size=2)
    about = lfilter([1.0], [1.0, -kept], drawn, zi=[kept * first])[0]
    return np.real(about * np.exp(2j * np.pi * frequency_hz * time_s))


def _sways(trials: Sequence[CellTrial], frequency_hz: float, *, in_contact: bool) -> list[CellTrial]:
    """Return trials with a tone of 0.3 mN rms that keeps its phase for 0.3 s, everywhere or while skin is pressed."""
    random = np.random.default_rng(8)
    swaying = []
    for trial in trials:
        tone_mn = 0.3 * _swaying(random, trial.full_time_s, frequency_hz, 0.3)
        if in_contact:
            touching = np.isin(trial.phase, [PHASE_NAMES.index(p) for p in ("ramp", "hold")])
            tone_mn *= trial.at_samples(touching.astype(np.float64)) > 0.5
        full_mn = trial.full_force_mn + tone_mn.astype(np.float32)
        force_mn = trial.cell_means(full_mn.astype(np.float64))
        swaying.append(replace(trial, full_force_mn=full_mn, force_mn=force_mn))
    return swaying


@pytest.mark.parametrize("frequency_hz", [10.0, 22.0])
def test_a_building_that_sways_is_noise_of_a_band(fit: StudyFit, frequency_hz: float) -> None:
    """A tone that loses its phase left what no mechanism names, and one of 10 Hz was named tremor of the skin."""
    beside, lines = beside_tones(fit_baseline(_sways(fit.trials, frequency_hz, in_contact=False)))
    assert lines == ()
    (band,) = beside.noise.bands
    assert band.variance == pytest.approx(0.09, rel=0.25)
    assert band.frequency_hz == pytest.approx(frequency_hz, abs=0.3)
    assert band.lasts_s == pytest.approx(0.3, rel=0.4)
    assert not remainder_of(Account(beside), Account(beside)).significant


def test_what_trembles_in_contact_alone_is_no_building(fit: StudyFit) -> None:
    beside, _ = beside_tones(fit_baseline(_sways(fit.trials, 10.0, in_contact=True)))
    assert beside.noise.bands == ()
    quicker, _ = beside_tones(fit_baseline(_sways(fit.trials, 22.0, in_contact=True)))
    assert remainder_of(Account(quicker), Account(quicker)).lasts


@pytest.mark.parametrize("kept_s", [0.1, 0.3, 1.0, np.inf])
def test_a_tone_is_told_from_one_that_loses_its_phase(kept_s: float) -> None:
    random, n, rate_hz = np.random.default_rng(9), 5000, 1000.0
    stretches = []
    for _ in range(16):
        tone = 0.4 * _swaying(random, np.arange(n) / rate_hz, 22.3, kept_s)
        stretches.append(tone + random.normal(0.0, 0.3, n))
    powers = spectra(stretches)
    at = int(np.argmax(powers.mean(axis=0)))
    told = sways(powers, np.full_like(powers, 0.09), at, np.arange(at - 30, at + 30), rate_hz)
    if kept_s == np.inf:
        assert told is None
    else:
        assert told is not None
        variance, frequency_hz, found_s = told
        assert variance == pytest.approx(0.16, rel=0.3)
        assert frequency_hz == pytest.approx(22.3, abs=0.3)
        assert found_s == pytest.approx(kept_s, rel=0.3)
