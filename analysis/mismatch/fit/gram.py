"""Evidence in small matrices: products of projected columns, and what generalised least squares says of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.model.effects import TISSUE_SIZE

FloatArray = NDArray[np.float64]

TINY = 1e-10


@dataclass(frozen=True)
class Grams:
    """Products (n, m, m) of the columns [population's mean (5), added (K), residual] of every trial.

    ``ridge`` (m,) is the precision of each coefficient before the trials were seen; it counts once, not by trial.
    ``n_cells`` counts the cells of all trials.
    """

    by_trial: FloatArray
    ridge: FloatArray
    n_cells: int

    @property
    def n_added(self) -> int:
        """Return K."""
        return int(self.by_trial.shape[1]) - TISSUE_SIZE - 1

    def total(self) -> FloatArray:
        """Return the products (m, m) summed over the trials."""
        return np.asarray(self.by_trial.sum(axis=0))


def gram(fit: StudyFit, columns: Iterable[FloatArray], ridge: FloatArray | None = None) -> Grams:
    """Return the products of a fit's trials with added columns (n_j, K) mN; ``ridge`` (K,) is their precision.

    The columns are taken trial by trial: those of a hundred trials at once fill memory.
    """
    products = []
    for projector, added in zip(fit.projectors, columns, strict=True):
        X = np.column_stack([projector.mean_columns, projector(added), projector.residual])
        products.append(X.T @ X)
    whole = np.zeros(len(products[0]))
    if ridge is not None:
        whole[TISSUE_SIZE:-1] = ridge
    return Grams(np.array(products), whole, sum(len(p.residual) for p in fit.projectors))


def solve(total: FloatArray, ridge: FloatArray, pick: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Return coefficients (p,) of picked columns and their covariance (p, p) by generalised least squares."""
    A = total[np.ix_(pick, pick)] + np.diag(ridge[list(pick)])
    scale = np.sqrt(np.maximum(np.diag(A), 1e-30))
    inverse = np.linalg.inv(A / np.outer(scale, scale) + TINY * np.eye(len(scale))) / np.outer(scale, scale)
    return inverse @ total[list(pick), -1], inverse
