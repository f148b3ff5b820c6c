"""Evidence of a trial given the others: against the joint density of all of them, written out."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from analysis.mismatch.evidence.heldout import predictive_deviance
from analysis.mismatch.fit.gram import Grams
from analysis.mismatch.model.effects import TISSUE_SIZE
from analysis.mismatch.model.population import DECADE

CELLS = 30


@given(st.integers(0, 10**6), st.integers(3, 6), st.integers(1, 4))
def test_a_trial_s_density_is_that_of_all_trials_over_that_of_the_others(
    seed: int, n_trials: int, n_added: int
) -> None:
    random = np.random.default_rng(seed)
    p = TISSUE_SIZE + n_added
    X = random.normal(size=(n_trials, CELLS, p))
    # the last column shows in one trial only
    X[1:, :, -1] = 0.0
    y = random.normal(size=(n_trials, CELLS)) + X @ random.normal(size=p)
    precision = random.uniform(0.1, 3.0, size=n_added)
    products = []
    for j in range(n_trials):
        Z = np.column_stack([X[j], y[j]])
        products.append(Z.T @ Z)
    ridge = np.concatenate([np.zeros(TISSUE_SIZE), precision, [0.0]])
    deviance = predictive_deviance(Grams(np.array(products), ridge, n_trials * CELLS), range(n_added))
    known = np.concatenate([np.full(TISSUE_SIZE, DECADE**-2), precision])

    def written_out(of: list[int]) -> float:
        columns, force = np.concatenate(X[of]), np.concatenate(y[of])
        covariance = np.eye(len(force)) + columns / known @ columns.T
        return float(force @ np.linalg.solve(covariance, force) + np.linalg.slogdet(covariance)[1])

    everyone = list(range(n_trials))
    expected = [written_out(everyone) - written_out([i for i in everyone if i != j]) for j in everyone]
    np.testing.assert_allclose(deviance, expected, rtol=1e-7)
