"""Populations of tissues found back from what single trials say, and own parameters taken out of columns."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.mismatch.evidence.heldout import heldout_deviance
from analysis.mismatch.fit.gram import Grams
from analysis.mismatch.model.population import OF_SITE, Population, estimate, site_variance

MEAN = np.log([120.0, 44.0, 2.3, 35.0, 0.15])


def _likelihoods(scatter: float, n: int, error: float, seed: int) -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(seed)
    H = np.eye(5) / error**2
    found = []
    for _ in range(n):
        seen = MEAN + rng.normal(0.0, scatter, 5) + rng.normal(0.0, error, 5)
        found.append((H, H @ seen))
    return found


def test_no_arm_is_quicker_than_recordings_resolve() -> None:
    # a hundred times quicker than a two thousandth of 20 s, as an arm is that stands for a dashpot
    quick = MEAN - np.log(1e4) * np.array([0, 0, 0, 0, 1])
    H = np.eye(5) / 0.01**2
    found = estimate([(H, H @ quick)] * 20, Population.weak(MEAN, 20.0))
    assert np.exp(found.mean[4]) == pytest.approx(0.01)
    assert found.mean[:4] == pytest.approx(MEAN[:4], abs=1e-3)


@pytest.mark.parametrize("scatter", [0.1, 0.2])
def test_what_varies_is_estimated_as_varying(scatter: float) -> None:
    # 100 trials know a scatter to 7 %; the prior of two trials is 2 % of them. Five sigmas: false failures below 1e-5
    found = estimate(_likelihoods(scatter, 100, 0.01, 3), Population.weak(MEAN, 20.0))
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(scatter, rel=0.36)
    assert np.abs(found.mean - MEAN).max() < 5 * scatter / 10


def test_what_does_not_vary_is_estimated_as_not_varying() -> None:
    # known to 0.2 % in every trial; were it to vary by as much, twenty trials would show it
    found = estimate(_likelihoods(0.0, 20, 0.002, 4), Population.weak(MEAN, 20.0))
    assert np.sqrt(np.diag(found.covariance)).max() < 0.003


def test_what_only_the_gain_varies_varies_in_stiffness_alone() -> None:
    rng = np.random.default_rng(6)
    H = np.eye(5) / 0.002**2
    gains = rng.normal(0.0, 0.03, 20)
    seen = MEAN + gains[:, None] * np.array([1, 1, 0, 1, 0]) + rng.normal(0.0, 0.002, (20, 5))
    found = estimate([(H, H @ s) for s in seen], Population.weak(MEAN, 20.0))
    scatter = np.sqrt(np.diag(found.covariance))
    # 20 trials know a scatter to 16 %: five sigmas, false failures below 1e-5
    assert scatter[[0, 1, 3]] == pytest.approx(0.03, rel=0.8)
    assert scatter[[2, 4]].max() < 0.003


@pytest.mark.parametrize("n", [1, 2, 3, 4, 6])
def test_few_trials_of_living_skin_are_not_taken_for_one_piece(n: int) -> None:
    # no constant's scatter may be thought a hundredth of what it is because few trials did not happen to show it
    for seed in range(20):
        found = estimate(_likelihoods(0.1, n, 0.003, seed), Population.weak(MEAN, 20.0))
        assert np.sqrt(np.linalg.eigvalsh(found.covariance).min()) > 0.005


def test_a_population_is_no_wilder_than_skin() -> None:
    found = estimate(_likelihoods(2.0, 20, 0.01, 5), Population.weak(MEAN, 20.0))
    assert np.linalg.eigvalsh(found.covariance).max() <= 0.4**2 * (1 + 1e-9)


@pytest.mark.parametrize("scatter", [0.05, 0.12])
def test_a_size_that_varies_between_sites_is_estimated_as_varying(scatter: float) -> None:
    # 100 trials know a scatter to 7 %, the prior of two is 2 % of them. Five sigmas: false failures below 1e-5
    rng = np.random.default_rng(7)
    H = np.full(100, 1.0 / 0.02**2)
    seen = rng.normal(0.0, scatter, 100) + rng.normal(0.0, 0.02, 100)
    assert np.sqrt(site_variance(H, H * seen)) == pytest.approx(min(scatter, OF_SITE), rel=0.36)


@given(seed=st.integers(0, 2**31), error=st.floats(1e-3, 1e3), n=st.integers(4, 30))
@settings(deadline=None, max_examples=50)
def test_what_differs_no_more_than_it_is_known_does_not_vary(seed: int, error: float, n: int) -> None:
    """Nor is it said to vary by more than skin does, were it to, nor by less where trials say nothing of it."""
    rng = np.random.default_rng(seed)
    H = np.full(n, error**-2)
    all_alike = np.sqrt(site_variance(H, np.zeros(n)))
    assert all_alike <= max(0.02, min(error, OF_SITE)) * (1.0 + 1e-9)
    far_apart = H * rng.normal(0.0, 100.0 * (error + OF_SITE), n)
    assert all_alike <= np.sqrt(site_variance(H, far_apart)) <= OF_SITE * (1.0 + 1e-9)


@given(seed=st.integers(0, 2**31))
@settings(deadline=None, max_examples=30)
def test_held_out_deviance_is_that_of_a_fit_to_the_other_trials(seed: int) -> None:
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(6, 40, 7))
    y = rng.normal(size=(6, 40))
    columns = np.concatenate([X, y[:, :, None]], axis=2)
    grams = Grams(np.einsum("jnp,jnq->jpq", columns, columns), np.zeros(8), 240)
    found = heldout_deviance(grams, [0, 1])
    for j in range(6):
        others = [k for k in range(6) if k != j]
        b = np.linalg.lstsq(X[others].reshape(-1, 7), y[others].ravel(), rcond=None)[0]
        assert found[j] == pytest.approx(float(((y[j] - X[j] @ b) ** 2).sum()), rel=1e-6)
