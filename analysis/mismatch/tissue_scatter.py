"""How much the tissue differs from trial to trial, as far as the residuals tell it from noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

FEWEST_FREEDOM = 4
ROUNDS = 200


@dataclass(frozen=True)
class Scatter:
    """Scatter of the shared parameters over trials.

    ``spread`` (P, K): K independent deviations of unit variance times these columns make up a trial's, on the scale
    of the fit. ``gain``: by how much such a scatter improves on one tissue for all, twice the logarithm of the
    likelihood.
    """

    spread: FloatArray
    gain: float

    @staticmethod
    def none(n_parameters: int) -> Scatter:
        """Return no scatter: one tissue for all trials."""
        return Scatter(np.zeros((n_parameters, 0)), 0.0)


def scatter_over(residuals: Sequence[FloatArray], columns: Sequence[FloatArray]) -> Scatter:
    """Measure the scatter from whitened residuals (n_j,) and derivatives by the shared parameters (n_j, P), by trial.

    In coordinates in which the mean information is the unit matrix, noise alone gives the trials' gradients unit
    variance in every direction; a direction in which they have more than the largest variance that T trials of P
    parameters show by chance (1 + sqrt(P / T))^2 (Marchenko, Pastur 1967) scatters by the excess.
    """
    n = len(residuals)
    p = columns[0].shape[1] if n else 0
    if n < 2 or not p:
        return Scatter.none(p)
    to_unit = _to_unit(np.mean([J.T @ J for J in columns], axis=0))
    gradients = np.array([to_unit.T @ (J.T @ r) for r, J in zip(residuals, columns, strict=True)])
    variance, directions = np.linalg.eigh(gradients.T @ gradients / (n - 1))
    much = variance > (1.0 + np.sqrt(gradients.shape[1] / n)) ** 2
    spread = to_unit @ directions[:, much] * np.sqrt(variance[much] - 1.0)
    gain = float(n * np.sum(variance[much] - 1.0 - np.log(variance[much])))
    return Scatter(spread, gain)


def scatter_of_repeats(
    information: Sequence[FloatArray], gradients: Sequence[FloatArray], conditions: Sequence[str]
) -> Scatter:
    """Measure by how much repeats of one condition differ, from each trial's information (P, P) and gradient (P,).

    What all trials of a condition deviate by is a mismatch that repeats, and none of this. Deviations are taken as
    Gaussian; their covariance is that of largest likelihood, by expectation and maximisation (Laird, Ware, Biometrics
    38:963, 1982). A direction in which it is less than noise alone would show by chance (see `scatter_over`) is none.
    """
    labels = np.asarray(conditions)
    p = len(gradients[0])
    repeated = [g for g in (np.flatnonzero(labels == c) for c in np.unique(labels)) if len(g) > 1]
    freedom = sum(len(g) - 1 for g in repeated)
    if freedom < FEWEST_FREEDOM or not p:
        return Scatter.none(p)
    members = np.concatenate(repeated)
    to_unit = _to_unit(np.mean([information[j] for j in members], axis=0))
    H = np.array([to_unit.T @ information[j] @ to_unit for j in members])
    g = np.array([to_unit.T @ gradients[j] for j in members])
    # (members, groups): a group's mean is taken with the weights of its members, and spread over them
    one_of = np.equal.outer(labels[members], np.unique(labels[members])).astype(np.float64)
    share = one_of / one_of.sum(axis=0)
    of_group = np.einsum("jc,jpq->cpq", one_of, H)
    mean = np.einsum("cpq,cq->cp", np.linalg.pinv(of_group, rcond=1e-12, hermitian=True), one_of.T @ g)
    unit = np.eye(to_unit.shape[1])
    covariance = unit
    for _ in range(ROUNDS):
        left = g - np.einsum("jpq,jq->jp", H, one_of @ mean)
        # (S^-1 + H)^-1 = S (1 + H S)^-1
        posterior = covariance @ np.linalg.inv(unit + H @ covariance)
        expected = np.einsum("jpq,jq->jp", posterior, left)
        mean = mean + share.T @ expected
        expected = expected - one_of @ (share.T @ expected)
        covariance = posterior.mean(axis=0) + expected.T @ expected / freedom
        covariance = 0.5 * (covariance + covariance.T)
    left = g - np.einsum("jpq,jq->jp", H, one_of @ mean)
    variance, directions = np.linalg.eigh(covariance)
    much = variance > (1.0 + np.sqrt(len(unit) / freedom)) ** 2 - 1.0
    kept = directions[:, much] * np.sqrt(variance[much])
    within = np.eye(kept.shape[1]) + np.einsum("pk,jpq,ql->jkl", kept, H, kept)
    along = left @ kept
    explained = np.einsum("jk,jk->", along, np.linalg.solve(within, along[:, :, None])[:, :, 0])
    gain = float(explained - np.sum(np.linalg.slogdet(within)[1]))
    return Scatter(to_unit @ kept, gain) if gain > 0 else Scatter.none(p)


def _to_unit(mean: FloatArray) -> FloatArray:
    """Return what turns parameters into coordinates in which their mean information (P, P) is the unit matrix."""
    scale = np.sqrt(np.maximum(np.diag(mean), 1e-300))
    size, turn = np.linalg.eigh(mean / np.outer(scale, scale))
    seen = size > 1e-9 * size[-1]
    return np.asarray(turn[:, seen] / np.sqrt(size[seen]) / scale[:, None])
