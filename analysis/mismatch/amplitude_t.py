"""Significance of a law's amplitude by a moderated t over trials, where flipping their signs can tell too little.

A flip test of n trials cannot exceed sqrt(n): an effect stands among its own flips. A t-test takes the scatter of the
trials about the amplitude, which holds no effect, and trusts it to be near Gaussian.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import digamma, polygamma
from scipy.stats import norm
from scipy.stats import t as student_t

from analysis.mismatch.signatures import Signatures

FloatArray = NDArray[np.float64]

CONTRIBUTES = 0.03
FEWEST_EFFECTIVE = 2.0
FEWEST_TRIALS = 3
MOST_FREEDOM = 40.0
DRAWS = 20_000


def amplitude_p_value(signatures: Signatures, rng: np.random.Generator) -> FloatArray:
    """Return p-values (M,) of the probes' amplitudes, over all probes together.

    The amplitude is estimated from each trial that contributes; its t takes the trials' scatter about it, drawn
    towards the other probes'. How large the largest of so many t is by chance is drawn from Gaussian scores that are
    correlated as the signatures are. Probes that fewer than three trials speak of have p-value 1.
    """
    norm2 = signatures.trial_norm2
    p_value = np.ones(norm2.shape[1])
    effective = norm2.sum(axis=0) ** 2 / np.maximum((norm2**2).sum(axis=0), 1e-300)
    seen = np.flatnonzero(
        (signatures.norm > 1e-4 * np.maximum(signatures.raw_norm, 1e-12)) & (effective > FEWEST_EFFECTIVE)
    )
    used = norm2[:, seen] > CONTRIBUTES * norm2[:, seen].max(axis=0, initial=0.0)
    enough = used.sum(axis=0) >= FEWEST_TRIALS
    seen, used = seen[enough], used[:, enough]
    if not len(seen):
        return p_value
    weight = np.where(used, norm2[:, seen], 0.0)
    score = np.where(used, signatures.trial_scores[:, seen], 0.0)
    amplitude = score.sum(axis=0) / weight.sum(axis=0)
    squares = np.divide((score - amplitude * weight) ** 2, weight, out=np.zeros_like(weight), where=used)
    freedom = used.sum(axis=0) - 1.0
    spread, freedom = moderated(squares.sum(axis=0) / freedom, freedom)
    t = amplitude * np.sqrt(weight.sum(axis=0) / spread)
    one_sided = np.array([signatures.probes[k].mechanism.one_sided for k in seen])
    as_gaussian = norm.isf(student_t.sf(np.where(one_sided, t, np.abs(t)), freedom))
    size = signatures.norm[seen]
    variance, directions = np.linalg.eigh(signatures.gram[np.ix_(seen, seen)] / np.outer(size, size))
    drawn = rng.standard_normal((DRAWS, len(seen))) @ (directions * np.sqrt(np.maximum(variance, 0.0))).T
    largest = np.sort(np.where(one_sided, drawn, np.abs(drawn)).max(axis=1))
    beyond = DRAWS - np.searchsorted(largest, as_gaussian)
    p_value[seen] = (1.0 + beyond) / (DRAWS + 1.0)
    return p_value


def moderated(variance: FloatArray, freedom: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return variances (M,) drawn towards each other, and their degrees of freedom with what that adds.

    The prior's variance s0^2 and degrees of freedom d0 are those that make the variances s^2 scatter as they do:
    (d0 s0^2 + d s^2) / (d0 + d); Smyth, Stat. Appl. Genet. Mol. Biol. 3:3 (2004), eqs. 5 to 8. As the probes are
    not independent, d0 is kept to ``MOST_FREEDOM``, and s0^2 to no less than the white noise's 1.
    """
    e = np.log(np.maximum(variance, 1e-3)) - digamma(freedom / 2) + np.log(freedom / 2)
    excess = float(np.var(e, ddof=1) - np.mean(polygamma(1, freedom / 2))) if len(e) > 1 else 0.0
    d0 = MOST_FREEDOM
    if excess > float(polygamma(1, MOST_FREEDOM / 2)):
        d0 = 2 * float(brentq(lambda half: float(polygamma(1, half)) - excess, 1e-3, MOST_FREEDOM / 2))
    s0 = max(float(np.exp(np.mean(e) + digamma(d0 / 2) - np.log(d0 / 2))), 1.0)
    return (d0 * s0 + freedom * variance) / (d0 + freedom), d0 + freedom
