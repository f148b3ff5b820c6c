"""Evidence that a law explains why the tissues of trials differ: once it is added, they scatter less."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.fit.settled import Settled
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.model.effects import TISSUE_SIZE
from analysis.mismatch.model.population import FEWEST_ALIKE, PRIOR_SCATTERS, PRIOR_TRIALS

FloatArray = NDArray[np.float64]

ROUNDS = 8


def scatter_explained(fit: StudyFit, settled: Sequence[Settled]) -> list[tuple[float, float]]:
    """Return of each of K templates the gain in nats by what it explains of the tissues' scatter, and its coefficient.

    A law of coefficient a moves the log constants of each trial by a s_j, and n trials so scattered have a likelihood
    of -n/2 ln |sum_j (d_j + a s_j)(d_j + a s_j)' + C|, C what is not known of them (the profile likelihood of a
    covariance). To a line, in which the population stands, a law that explains all of their scatter gains no more than
    half a nat for each trial and constant.
    """
    pressed = [j for j, state in enumerate(fit.states) if state.has_tissue]
    if len(pressed) < FEWEST_ALIKE:
        return [(0.0, 0.0)] * len(settled[0].log_tissue)
    unknown = PRIOR_TRIALS * min(PRIOR_SCATTERS) ** 2 * np.eye(TISSUE_SIZE)
    for own in (fit.own[j] for j in pressed):
        unknown += own.covariance[own.tissue, own.tissue]
    D = np.array([fit.states[j].log_tissue for j in pressed])
    moved = np.array([settled[j].log_tissue for j in pressed])
    D = D - D.mean(axis=0)
    return [_best(D, by - by.mean(axis=0), unknown) for by in np.swapaxes(moved, 0, 1)]


def _best(D: FloatArray, S: FloatArray, unknown: FloatArray) -> tuple[float, float]:
    """Return by how many nats D + a S (n, 5) scatters less at the best a, and that a."""

    def scattered(a: float) -> FloatArray:
        return np.asarray((D + a * S).T @ (D + a * S) + unknown)

    if not np.any(S):
        return 0.0, 0.0
    a = 0.0
    for _ in range(ROUNDS):
        weight = np.linalg.inv(scattered(a))
        a = -float(np.sum(weight * (S.T @ D))) / float(np.sum(weight * (S.T @ S)))
    gain = 0.5 * len(D) * (np.linalg.slogdet(scattered(0.0))[1] - np.linalg.slogdet(scattered(a))[1])
    return float(gain), a
