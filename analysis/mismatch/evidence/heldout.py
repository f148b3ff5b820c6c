"""How well the other trials predict each one: evidence that no fitted coefficient can flatter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, solve_triangular

from analysis.mismatch.fit.gram import Grams, solve
from analysis.mismatch.levels import FEWEST_HELD_OUT
from analysis.mismatch.model.effects import TISSUE_SIZE
from analysis.mismatch.model.population import DECADE

FloatArray = NDArray[np.float64]


def heldout_deviance(grams: Grams, added: Sequence[int]) -> FloatArray:
    """Return each trial's chi2 (n,) at the coefficients that the other trials give (leave one trial out).

    ``added`` are the columns used beside the population's mean. Of fewer than three trials none can be held out: there
    it is the fitted one.
    """
    pick = [*range(TISSUE_SIZE), *(TISSUE_SIZE + k for k in added)]
    total = grams.total()
    found = np.zeros(len(grams.by_trial))
    for j, G in enumerate(grams.by_trial):
        b, _ = solve(total if len(found) < FEWEST_HELD_OUT else total - G, grams.ridge, pick)
        found[j] = G[-1, -1] - 2.0 * b @ G[pick, -1] + b @ G[np.ix_(pick, pick)] @ b
    return found


def predictive_deviance(grams: Grams, added: Sequence[int]) -> FloatArray:
    """Return -2 ln of each trial's density (n,) given the other trials, but for its noise's determinant.

    What the others leave open of a coefficient widens the prediction: e' (1 + X C X')^-1 e + ln det(1 + C X'X) with
    C the coefficients' covariance by the others and what is known beforehand, e the residual at their estimate
    (Geisser and Eddy, J. Am. Stat. Assoc. 74:153, 1979). What a single trial shows counts so too. Of fewer than
    three trials none can be held out: there the fitted chi2 is raised by ln(cells) for every column (Schwarz 1978).
    """
    pick = [*range(TISSUE_SIZE), *(TISSUE_SIZE + k for k in added)]
    if len(grams.by_trial) < FEWEST_HELD_OUT:
        return np.asarray(
            heldout_deviance(grams, added) + len(added) * np.log(grams.n_cells) / len(grams.by_trial)
        )
    known = grams.ridge[pick].copy()
    known[:TISSUE_SIZE] += 1.0 / DECADE**2
    total = grams.total()
    A = total[np.ix_(pick, pick)] + np.diag(known)
    scale = 1.0 / np.sqrt(np.diag(A))
    whole = np.linalg.cholesky(scale[:, None] * A * scale)
    found = np.zeros(len(grams.by_trial))
    for j, G in enumerate(grams.by_trial):
        X, y = G[np.ix_(pick, pick)], G[pick, -1]
        others = np.linalg.cholesky(scale[:, None] * (A - X) * scale)
        b = scale * cho_solve((others, True), scale * (total[pick, -1] - y))
        at = y - X @ b
        h = solve_triangular(whole, scale * at, lower=True)
        e = G[-1, -1] - b @ (y + at)
        found[j] = e - h @ h + 2.0 * np.log(np.diag(whole) / np.diag(others)).sum()
    return found
