"""The population that trials' tissues are drawn from: mean and covariance of the logarithms of five constants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

WEAK = 0.5
"""Before anything is known a constant is known to half its logarithm: tissues of one kind differ by less."""
PLAUSIBLE = 0.4
"""No population of skin scatters by more (published: 0.1 to 0.2): what would need it is something else than tissue."""
OF_SITE = 0.15
"""By no more differs between sites what is the skin's, beside its constants (of these published: 0.1 to 0.2)."""
DECADE = 2.3
"""A mean is known to a decade before the trials were seen: constants that do not show must not run away."""
PARTS_RESOLVED = 2000.0
"""Nothing that relaxes in less of a recording is an arm of the tissue: over a ramp it would be a dashpot."""
TIMES = [2, 4]
"""Where the relaxation times stand among the log constants."""
ENDED = 0.01
"""How near to its least a logarithm has ended there."""
PRIOR_TRIALS = 2.0
PRIOR_SCATTERS = (0.02, 0.002)
"""What does not vary shrinks towards one of these, whichever tells better what trials not used for it are like: where
one piece of skin is pressed again and again two hundredths are far too much."""
ROUNDS = 60
"""Of EM."""
FEWEST_ALIKE = 4
"""Fewer trials that are alike may be so by chance: on living skin three pairs in ten, one in fifty of three."""


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
    def arm_ended(self) -> bool:
        """Whether an arm ended at its shortest: it stands for what resists speed, and the other for both of its own."""
        return bool(np.any(self.mean[TIMES] <= self.lowest[TIMES] + ENDED))

    @cached_property
    def precision(self) -> FloatArray:
        """Inverse covariance (5, 5)."""
        return np.asarray(np.linalg.inv(self.covariance), dtype=np.float64)


def estimate(likelihoods: Sequence[tuple[FloatArray, FloatArray]], start: Population) -> Population:
    """Return the population that is likeliest by single trials' likelihoods of log constants, each seen by the others.

    A likelihood is the information H (5, 5) of one trial and H times its estimate (5,).
    """
    H = np.array([h for h, _ in likelihoods])
    Ht = np.array([ht for _, ht in likelihoods])
    scatters = PRIOR_SCATTERS if len(H) >= FEWEST_ALIKE else PRIOR_SCATTERS[:1]
    return max((_by_em(H, Ht, start, s) for s in scatters), key=lambda found: found[1])[0]


def site_variance(H: FloatArray, Ht: FloatArray) -> float:
    """Return the variance that is likeliest of what a law's log size differs by between sites, by EM.

    ``H`` (n,) is the information of single trials, ``Ht`` (n,) that times their estimates. As of the tissue: what does
    not vary shrinks towards a small scatter, and no skin scatters by more than is plausible of it.
    """
    variance = OF_SITE**2
    for _ in range(ROUNDS):
        C = 1.0 / (H + 1.0 / variance)
        squares = float(np.sum((C * Ht) ** 2 + C)) + PRIOR_TRIALS * PRIOR_SCATTERS[0] ** 2
        variance = min(squares / (len(H) + PRIOR_TRIALS), OF_SITE**2)
    return variance


def _by_em(H: FloatArray, Ht: FloatArray, start: Population, scatter: float) -> tuple[Population, float]:
    """Return the population by EM, and the log likelihood of every trial by what the others say of the population.

    The covariance has an inverse Wishart prior of two trials' weight about ``scatter``, towards which what does not
    vary shrinks (Dempster, Laird, Rubin 1977).
    """
    mean, covariance = start.mean, start.covariance
    n, size = Ht.shape
    for _ in range(ROUNDS):
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
        scale = D.T @ D + C.sum(axis=0) + PRIOR_TRIALS * scatter**2 * np.eye(size)
        covariance = _plausible(scale / (n + PRIOR_TRIALS))
    # the others' mean, and how they lie about it
    others = max(n - 1, 1)
    own = np.einsum("ja,jb->jab", D, D) * n / others + C
    seen = _log_likelihood(H, Ht, mean - D / others, _plausible((scale - own) / (n - 1 + PRIOR_TRIALS)))
    return Population(mean, covariance, start.lowest), float(seen.sum())


def _plausible(covariance: FloatArray) -> FloatArray:
    """Return covariances (..., 5, 5) of which none scatters by more than is plausible in any direction."""
    values, vectors = np.linalg.eigh(covariance)
    capped = vectors * np.minimum(values, PLAUSIBLE**2)[..., None, :]
    return np.asarray(capped @ np.swapaxes(vectors, -1, -2))


def _log_likelihood(H: FloatArray, Ht: FloatArray, mean: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return ln (n,) of each trial's likelihood, its tissue drawn from means (n, 5) and covariances (n, 5, 5)."""
    precision = np.linalg.inv(covariance)
    # about the mean, or large numbers are subtracted from each other
    gradient = Ht - np.einsum("jab,jb->ja", H, mean)
    moved = np.linalg.solve(H + precision, gradient[..., None])[..., 0]
    of_mean = np.einsum("ja,ja->j", Ht - 0.5 * np.einsum("jab,jb->ja", H, mean), mean)
    ratio = np.linalg.slogdet(H @ covariance + np.eye(Ht.shape[1]))[1]
    return np.asarray(of_mean + 0.5 * (np.einsum("ja,ja->j", gradient, moved) - ratio))
