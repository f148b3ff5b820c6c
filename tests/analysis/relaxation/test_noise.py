"""The noise's spectrum and what it makes of standard errors."""

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.relaxation.noise import estimate_covariance, influences, measure_noise

N = 40000
EDGES = np.arange(0, N + 1, 50)
TIME = (EDGES[:-1] + 25) / N
JACOBIAN = np.stack([np.ones_like(TIME), TIME, np.exp(-8 * TIME)])


def noise(rng: np.random.Generator, correlation: float) -> np.ndarray:
    """White noise, with a slow part of half its deviation where ``correlation`` (samples) is not 0."""
    white = rng.normal(size=N)
    if not correlation:
        return white
    decay = np.exp(-1 / correlation)
    gain = np.sqrt(1 - decay**2)
    return white + 0.5 * lfilter([gain], [1, -decay], rng.normal(size=N + 20000))[20000:]


@pytest.mark.parametrize("correlation", [0, 30, 400, 1500])
def test_errors_match_the_scatter_of_estimates(correlation: float):
    # 250 draws: a standard deviation is known to 4.5 %, five of those are 22 %; 3 estimates, all alike
    rng = np.random.default_rng(correlation)
    influence = influences(JACOBIAN, np.diff(EDGES).astype(float))
    estimates, variances = [], []
    for _ in range(250):
        error = noise(rng, correlation)
        means = np.add.reduceat(error, EDGES[:-1]) / 50
        estimate = influence @ (means * 50)
        residual = error - np.repeat(estimate @ JACOBIAN, 50)
        spectrum = measure_noise(residual, JACOBIAN, EDGES)
        estimates.append(estimate)
        variances.append(np.diag(estimate_covariance(JACOBIAN, EDGES, spectrum)))
    ratio = np.std(estimates, axis=0) / np.sqrt(np.mean(variances, axis=0))
    np.testing.assert_allclose(ratio, 1.0, atol=0.22)


def test_white_noise_has_the_textbook_covariance():
    residual = np.random.default_rng(1).normal(size=N)
    spectrum = measure_noise(residual, JACOBIAN, EDGES)
    want = np.linalg.inv(JACOBIAN @ JACOBIAN.T * 50)
    np.testing.assert_allclose(estimate_covariance(JACOBIAN, EDGES, spectrum), want, rtol=0.06)
    assert abs(spectrum.slow_ratio - 1.0) < 5 * spectrum.slow_ratio_se


def test_no_noise_no_error():
    spectrum = measure_noise(np.zeros(N), JACOBIAN, EDGES)
    assert not estimate_covariance(JACOBIAN, EDGES, spectrum).any()
