"""Single samples that are further off than any noise: sparks on a line, bits that a converter drops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, minimize
from scipy.special import ndtr, stdtr

from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.locate.transients import NO_BURSTS, Bursts, at_rest, phase_at
from analysis.simulation.samples import FAR, deviations

FloatArray = NDArray[np.float64]

EDGES = np.concatenate([[0.0], np.geomspace(0.05, 1e4, 300), [np.inf]])
"""Robust deviations by which samples are counted."""
TAIL = 6.0
"""Deviations that a second, rarer kind of noise may have; from `FAR` it is none."""
OFTEN = 0.05
"""What is off more often than that is no outlier."""
FREEDOMS = (2.5, 5.0, 30.0)
"""Degrees of freedom from which the noise is fitted."""
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
    scattered = [deviations(fit.full_residual_mn(j), rest) for j, rest in enumerate(kept)]
    whole = tails(np.concatenate([s.off for s in scattered]))
    if whole.evidence <= 0.0:
        return NO_BURSTS
    j = int(np.argmax([np.abs(s.off).max(initial=0.0) for s in scattered]))
    most = int(np.argmax(np.abs(scattered[j].off)))
    at_s = float(fit.trials[j].full_time_s[kept[j]][most])
    rms_mn = whole.far_sd * float(np.median([s.sigma_mn for s in scattered]))
    return Bursts(whole.evidence, phase_at(fit.trials[j], at_s), at_s, rms_mn)


def tails(off: FloatArray) -> Tails:
    """Weigh that samples (n,) hold some that are further off than noise.

    H0: Student's t, any degrees of freedom, with any rarer normal part up to `TAIL` deviations: heavy tails. H1: the
    same, and beside it a part beyond `FAR`. Samples are taken as independent; both are fitted to their counts.
    """
    counts = np.histogram(np.abs(off), EDGES)[0].astype(np.float64)
    far = np.abs(off)[np.abs(off) > FAR]
    if not far.size:
        return Tails(0.0, 0.0)
    least = 0.1 / len(off)
    noise_bounds = [(1.5, 150.0), (0.1, 3.0), (least, OFTEN), (1.0, TAIL)]
    far_bounds = [(least, OFTEN), (FAR, 100.0 * float(far.max()))]
    starts = [(freedom, 1.0, 1e-3, 0.5 * TAIL) for freedom in FREEDOMS]
    noise = _best(counts, starts, noise_bounds)
    rare = far.size / len(off)
    sizes = (2.0 * FAR, float(np.median(far)), float(np.sqrt(np.mean(far**2))))
    # noise that took the far part up has bent its bulk for it
    beside = [(*parts, rare, sd) for parts in (noise[1], starts[-1]) for sd in sizes]
    with_far = _best(counts, beside, [*noise_bounds, *far_bounds])
    far_sd = float(with_far[1][-1])
    if far_sd <= (1.0 + AT_BOUND) * FAR:
        # no part of its own: it mends what a t is not right about
        return Tails(0.0, far_sd)
    # what noise alone can do is known from there too
    noise = min(noise, _best(counts, [tuple(with_far[1][:-2])], noise_bounds), key=lambda m: m[0])
    return Tails(noise[0] - with_far[0] - PRICE, far_sd)


def _best(
    counts: FloatArray, starts: Sequence[Sequence[float]], bounds: Sequence[tuple[float, float]]
) -> tuple[float, FloatArray]:
    """Return -ln likelihood of counts under a t with rarer normal parts at its best, and the parameters there.

    They are the t's degrees of freedom and scale, and each rarer part's share and its deviation.
    """

    def misfit(x: FloatArray) -> float:
        freedom, scale, *parts = np.exp(x)
        # tails below: what is far out is not lost in the rounding of one
        p = (1.0 - sum(parts[::2])) * -np.diff(stdtr(freedom, -EDGES / scale))
        for share, sd in zip(parts[::2], parts[1::2], strict=True):
            p += share * -np.diff(ndtr(-EDGES / sd))
        return -float(counts @ np.log(np.maximum(2.0 * p, 1e-300)))

    within = np.log(bounds)
    fits = [
        minimize(
            misfit,
            np.clip(np.log(start), within[:, 0], within[:, 1]),
            bounds=Bounds(within[:, 0], within[:, 1]),
            method="Nelder-Mead",
            options={"maxiter": 1000, "xatol": 1e-3, "fatol": 0.05, "adaptive": True},
        )
        for start in starts
    ]
    found = min(fits, key=lambda fit: float(fit.fun))
    return float(found.fun), np.exp(found.x)
