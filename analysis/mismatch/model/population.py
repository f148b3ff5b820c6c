"""The population that trials' tissues are drawn from: mean and covariance of the logarithms of five constants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

WEAK = 0.5
"""Before anything is known a constant is known to half its logarithm: tissues of one kind differ by less."""
PLAUSIBLE = 0.4
"""No population of skin scatters by more (published: 0.1 to 0.2): what would need it is something else than tissue."""
OF_SITE = 0.15
"""By so much differs between sites what is the skin's, beside its constants (of these published: 0.1 to 0.2)."""
DECADE = 2.3
"""A mean is known to a decade before the trials were seen: constants that do not show must not run away."""
PARTS_RESOLVED = 2000.0
"""Nothing that relaxes in less of a recording is an arm of the tissue: over a ramp it would be a dashpot."""
TIMES = [2, 4]
"""Where the relaxation times stand among the log constants."""
PRIOR_TRIALS = 2.0
PRIOR_SCATTER = 0.02


@dataclass(frozen=True)
class Population:
    """Mean (5,) and covariance (5, 5) of a tissue's log constants, and how small (5,) they can be at all."""

    mean: FloatArray
    covariance: FloatArray
    lowest: FloatArray = field(default_factory=lambda: np.full(5, -np.inf))

    @staticmethod
    def weak(mean: FloatArray, recorded_s: float) -> Population:
        """Return a population that hardly says anything, of arms that recordings of such a length resolve."""
        lowest = np.full(len(mean), -np.inf)
        lowest[TIMES] = np.log(recorded_s / PARTS_RESOLVED)
        return Population(mean, WEAK**2 * np.eye(len(mean)), lowest)

    @property
    def precision(self) -> FloatArray:
        """Inverse covariance (5, 5)."""
        return np.asarray(np.linalg.inv(self.covariance), dtype=np.float64)


def estimate(
    likelihoods: Sequence[tuple[FloatArray, FloatArray]], start: Population, rounds: int = 60
) -> Population:
    """Return the population by EM from single trials' likelihoods of log constants.

    Each is the information H (5, 5) of one trial and H times its estimate (5,). The covariance has an inverse Wishart
    prior of two trials' weight about 2 %, towards which what does not vary shrinks (Dempster, Laird, Rubin 1977).
    """
    mean, covariance = start.mean, start.covariance
    size = len(mean)
    H = np.array([h for h, _ in likelihoods])
    Ht = np.array([ht for _, ht in likelihoods])
    for _ in range(rounds):
        precision = np.linalg.inv(covariance)
        C = np.linalg.inv(H + precision)
        means = np.einsum("jab,jb->ja", C, Ht + precision @ mean)
        # the mean by generalised least squares: a trial weighs (H^-1 + covariance)^-1
        total = precision @ (C @ H).sum(axis=0)
        weighed = precision @ np.einsum("jab,jb->a", C, Ht)
        # what no trial says anything of stays where it was
        mean = np.asarray(
            np.linalg.solve(total + np.eye(size) / DECADE**2, weighed + start.mean / DECADE**2),
            dtype=np.float64,
        )
        mean = np.maximum(mean, start.lowest)
        D = means - mean
        scale = D.T @ D + C.sum(axis=0) + PRIOR_TRIALS * PRIOR_SCATTER**2 * np.eye(size)
        values, vectors = np.linalg.eigh(scale / (len(likelihoods) + PRIOR_TRIALS))
        covariance = (vectors * np.minimum(values, PLAUSIBLE**2)) @ vectors.T
    return Population(mean, covariance, start.lowest)
