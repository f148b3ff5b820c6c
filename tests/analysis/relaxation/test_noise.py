"""The noise's spectrum and what it makes of standard errors."""

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.relaxation.autoregression import fit_autoregression, measured_covariances
from analysis.relaxation.noise import (
    estimate_covariance,
    influences,
    measure_noise,
    noise_covariance,
    widened,
)

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
    estimates, variances, errors = [], [], []
    for _ in range(250):
        error = noise(rng, correlation)
        means = np.add.reduceat(error, EDGES[:-1]) / 50
        estimate = influence @ (means * 50)
        residual = error - np.repeat(estimate @ JACOBIAN, 50)
        spectrum = measure_noise(residual, JACOBIAN, EDGES)
        estimates.append(estimate)
        variances.append(np.diag(noise_covariance(influence, EDGES, spectrum)[0]))
        errors.append(np.sqrt(np.diag(estimate_covariance(JACOBIAN, EDGES, spectrum))))
    ratio = np.std(estimates, axis=0) / np.sqrt(np.mean(variances, axis=0))
    np.testing.assert_allclose(ratio, 1.0, atol=0.22)
    # a share of 250 near 95 % is known to 1.4 %: three of those
    inside = np.mean(np.abs(estimates) < 1.96 * np.array(errors), axis=0)
    np.testing.assert_allclose(inside, 0.95, atol=0.042)


def test_an_autoregression_knows_how_unsure_its_slow_power_is():
    rng = np.random.default_rng(3)
    said, found = [], []
    for _ in range(300):
        values = lfilter([1], [1, -0.6], rng.normal(size=1100))[100:]
        fitted = fit_autoregression(measured_covariances(values, 1), np.ones(1000))
        said.append(np.sqrt(np.sum(np.square(fitted.doubts(np.zeros(1))))))
        found.append(np.log(fitted.power(np.zeros(1))[0]))
    # what is said counts one coefficient more than the one that made the noise
    assert 1.0 < np.mean(said) / np.std(found) < 1.5


def test_few_degrees_of_freedom_widen_an_error():
    covariance = np.array([[4.0, 1.0], [1.0, 1.0]])
    # a standard deviation of Student's distribution: root n / (n - 2) at n degrees of freedom
    ten = widened(covariance, 2.0 / 9.0 * np.array([16.0, 1.0]))
    np.testing.assert_allclose(ten, covariance * 10 / 8)
    np.testing.assert_allclose(widened(covariance, np.zeros(2)), covariance)


def test_white_noise_has_the_textbook_covariance():
    residual = np.random.default_rng(1).normal(size=N)
    spectrum = measure_noise(residual, JACOBIAN, EDGES)
    want = np.linalg.inv(JACOBIAN @ JACOBIAN.T * 50)
    np.testing.assert_allclose(estimate_covariance(JACOBIAN, EDGES, spectrum), want, rtol=0.06)
    assert abs(spectrum.slow_ratio - 1.0) < 5 * spectrum.slow_ratio_se


def test_no_noise_no_error():
    spectrum = measure_noise(np.zeros(N), JACOBIAN, EDGES)
    assert not estimate_covariance(JACOBIAN, EDGES, spectrum).any()
