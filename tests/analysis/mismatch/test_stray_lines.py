"""Lines that wander are found however little they wander; noise of any colour has none."""

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.mismatch.oscillations import stray_lines

RATE_HZ, SAMPLES, TRIALS = 8000.0, 40000, 20


def _noise(rng: np.random.Generator, correlated: float = 0.0, time_s: float = 1.0) -> np.ndarray:
    keeps = np.exp(-1.0 / (RATE_HZ * time_s))
    slow = lfilter([np.sqrt(1.0 - keeps**2)], [1.0, -keeps], rng.normal(size=SAMPLES))
    return np.asarray(rng.normal(size=SAMPLES) + correlated * slow)


@pytest.mark.parametrize(("correlated", "time_s"), [(0.0, 1.0), (0.7, 3e-3), (0.5, 4.0)])
def test_noise_has_no_lines(correlated: float, time_s: float) -> None:
    rng = np.random.default_rng(1)
    found = [
        p
        for _ in range(10)
        for _, _, p in stray_lines([_noise(rng, correlated, time_s) for _ in range(TRIALS)], RATE_HZ, 15.0)
    ]
    # a chance of 2e-4 for each of 10: once in 500
    assert min(found) > 2e-4


@pytest.mark.parametrize("wander_hz", [0.0, 0.3, 0.8])
def test_a_line_is_found_however_far_it_wanders(wander_hz: float) -> None:
    rng = np.random.default_rng(2)
    time_s = np.arange(SAMPLES) / RATE_HZ
    trials = []
    for _ in range(TRIALS):
        # a frequency that swings twice in a trial; energy 25 in units of the noise
        swing = np.sqrt(2.0) * wander_hz / 0.4 * np.sin(2 * np.pi * 0.4 * time_s + rng.uniform(0, 6.28))
        turn = 2 * np.pi * 25.0 * time_s + swing + rng.uniform(0, 6.28)
        trials.append(_noise(rng) + np.sqrt(2 * 25.0 / SAMPLES) * np.sin(turn))
    frequency_hz, rms, p = min(stray_lines(trials, RATE_HZ, 15.0), key=lambda line: line[2])
    assert p < 1e-6
    assert frequency_hz == pytest.approx(25.0, abs=1.5)
    assert rms == pytest.approx(np.sqrt(25.0 / SAMPLES), rel=0.4)
