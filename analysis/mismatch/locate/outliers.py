"""Single samples that are further off than any noise: sparks on a line, bits that a converter drops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtr

from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.locate.transients import NO_BURSTS, Bursts, at_rest, phase_at
from analysis.simulation.samples import FAR, deviations

FloatArray = NDArray[np.float64]

STEP = 1.25
"""From one deviation that is looked at to the next."""
EDGES = np.concatenate([[0.0, 1.0, 2.0], 3.0 * STEP ** np.arange(37.0), [np.inf]])
"""Robust deviations between which samples are counted, unless a converter has levels wider apart."""
TAIL = 6.0
"""Deviations that a second, rarer kind of noise may have; from `FAR` it is none."""
LARGEST = 1.5
"""Deviations that a heavy tail may have, the bulk's being one."""
NORMALS = np.geomspace(0.2, TAIL, 16)
"""Deviations of the bulk's parts and of the rarer ones."""
FREEDOMS, SCALES = (1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 10.0), np.geomspace(0.05, LARGEST, 12)
"""Degrees of freedom of heavy tails, and their deviations."""
ROUND, DONE = 200, 0.05
"""Steps of EM, and nats that so many must gain to go on."""
AT_BOUND = 0.01
"""Share of its least deviation by which a part must be beyond it, to be further off than noise."""
PRICE = 10.0
"""Nats for a size and a rate that were fitted beside the noise's, over a million samples (Schwarz 1978)."""


@dataclass(frozen=True)
class Tails:
    """How samples (counts by `EDGES`) scatter: evidence in nats that some are further off than noise, and how far.

    ``far_sd`` is in robust deviations.
    """

    evidence: float
    far_sd: float


def find_outliers(fit: StudyFit) -> Bursts:
    """Weigh single samples at rest in all trials; the largest is where they are."""
    kept = [at_rest(fit, j) for j in range(len(fit.trials))]
    level_mn = float(np.median([levels_apart(t.full_force_mn) for t in fit.trials]))
    residuals = [trial.as_loud_as_rest(fit.full_residual_mn(j)) for j, trial in enumerate(fit.trials)]
    scattered = [deviations(left, rest, level_mn) for left, rest in zip(residuals, kept, strict=True)]
    sigma_mn = float(np.median([s.sigma_mn for s in scattered]))
    whole = tails(np.concatenate([s.off for s in scattered]), level_mn / sigma_mn)
    if whole.evidence <= 0.0:
        return NO_BURSTS
    j = int(np.argmax([np.abs(s.off).max(initial=0.0) for s in scattered]))
    most = int(np.argmax(np.abs(scattered[j].off)))
    at_s = float(fit.trials[j].full_time_s[kept[j]][most])
    energy = sum(s.sigma_mn**2 * float(np.sum(s.off[np.abs(s.off) > FAR] ** 2)) for s in scattered)
    return Bursts(whole.evidence, phase_at(fit.trials[j], at_s), at_s, whole.far_sd * sigma_mn, energy)


def levels_apart(force_mn: NDArray[np.float32]) -> float:
    """Return how far the values that a force (N,) takes lie apart, mN: levels of a converter where it is coarse."""
    gaps = np.diff(np.unique(force_mn))
    return float(np.median(gaps)) if gaps.size else 0.0


def _edges(level: float) -> FloatArray:
    """Return `EDGES`, each moved to midway between two levels of a converter: samples lie on these only."""
    if level <= 0.0:
        return EDGES
    between = (np.round(EDGES[1:-1] / level - 0.5) + 0.5) * level
    return np.concatenate([[0.0], np.unique(between), [np.inf]])


def tails(off: FloatArray, level: float = 0.0) -> Tails:
    """Weigh that samples (n,) hold some that are further off than noise.

    H0: noise of any bulk and any heavy tails, of one source or of several: normals of at most `TAIL` deviations and
    Student's t of at most `LARGEST`, in any shares. H1: the same, and beside them normals beyond `FAR`. Samples are
    taken as independent; the shares are the likeliest of their counts (Kiefer and Wolfowitz, Ann. Math. Statist.
    27:887, 1956): as the likelihood has one maximum in them, it is found from anywhere. Samples may lie on levels, each
    so far from the next.
    """
    edges = _edges(level)
    counts = np.histogram(np.abs(off), edges)[0].astype(np.float64)
    furthest = float(np.abs(off).max(initial=0.0))
    if furthest <= FAR:
        return Tails(0.0, 0.0)
    sizes = FAR * STEP ** np.arange(np.ceil(np.log(furthest / FAR) / np.log(STEP)) + 1.0)
    normals, beyond = (2.0 * -np.diff(ndtr(-edges / sd[:, None])) for sd in (NORMALS, sizes))
    heavy = [-np.diff(stdtr(freedom, -edges / scale)) for freedom in FREEDOMS for scale in SCALES]
    noise = np.concatenate([normals, 2.0 * np.array(heavy)])
    without, _ = _likeliest(counts, noise)
    with_far, shares = _likeliest(counts, np.concatenate([noise, beyond]))
    far = shares[len(noise) :]
    far_sd = float(np.sqrt(far @ sizes**2 / max(float(far.sum()), 1e-300)))
    if far_sd <= (1.0 + AT_BOUND) * FAR:
        # no part of its own: it mends what noise is not right about
        return Tails(0.0, far_sd)
    return Tails(with_far - without - PRICE, far_sd)


def _likeliest(counts: FloatArray, parts: FloatArray) -> tuple[float, FloatArray]:
    """Return ln likelihood of counts (B,) under a mixture of parts (K, B) at its likeliest, and their shares (K,).

    By EM, in rounds until one gains nothing that counts.
    """
    n, shares, before = float(counts.sum()), np.full(len(parts), 1.0 / len(parts)), -np.inf
    while True:
        for _ in range(ROUND):
            expected = np.maximum(shares @ parts, 1e-300)
            shares = shares * (parts @ (counts / expected)) / n
        now = float(counts @ np.log(np.maximum(shares @ parts, 1e-300)))
        if now - before < DONE:
            return now, shares
        before = now
