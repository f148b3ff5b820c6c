"""Significance by sign-flips: trusts no noise model, only that noise is as likely to be turned round.

Hemerik, Goeman, Finos, J. R. Stat. Soc. B 82:841 (2020) (flips of score contributions, nuisance projected out),
with the maximum over all candidates (Westfall, Young 1993).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

FLIPS = 4999


@dataclass(frozen=True)
class FlipTest:
    """``statistic`` (M,) of each candidate and ``p_value`` (M,) over all candidates together.

    ``largest`` (FLIPS,) of the first family and ``smallest`` (FLIPS,) weighed share over all, both in rising order.
    """

    statistic: FloatArray
    p_value: FloatArray
    largest: FloatArray
    smallest: FloatArray

    def critical(self, level: float, share: float = 1.0) -> float:
        """Return the statistic that a candidate of the first family needs to be significant at a level."""
        allowed = float(np.quantile(self.smallest, level)) * share
        return float(np.quantile(self.largest, 1.0 - min(allowed, 1.0)))


@dataclass(frozen=True, slots=True)
class Family:
    """Candidates that are scanned together: how many, and their share of the false alarms allowed.

    Many candidates that are scanned on the chance of something (windows, frequencies) would otherwise raise the
    bar for the few that stand for known physics.
    """

    size: int
    share: float


def flip_test(
    scores: FloatArray,
    one_sided: NDArray[np.bool_],
    rng: np.random.Generator,
    families: Sequence[Family] = (),
) -> FlipTest:
    """Test score contributions (units, M) of M candidates by flipping the sign of whole units.

    The statistic is sum(s) / sqrt(sum(s^2)), its absolute value for two-sided candidates. Units are trials, or
    blocks of trials where there are few. Within a family the largest statistic of each flip counts; over families
    the smallest of their p-values, each divided by the family's share, calibrated by the same flips (Westfall and
    Young's min-P). Without ``families`` all candidates are one.
    """
    n = len(scores)
    size = np.sqrt((scores**2).sum(axis=0))
    unit = np.divide(scores, size, out=np.zeros_like(scores), where=size > 0)
    signs = rng.integers(0, 2, size=(FLIPS, n)) * 2.0 - 1.0
    observed = unit.sum(axis=0)
    observed = np.where(one_sided, observed, np.abs(observed))
    smallest = np.full(FLIPS, np.inf)
    weighed = np.ones(scores.shape[1])
    at = 0
    first: FloatArray | None = None
    for family in families or (Family(scores.shape[1], 1.0),):
        if not family.size:
            continue
        of = slice(at, at + family.size)
        at += family.size
        flipped = signs @ unit[:, of]
        largest = np.where(one_sided[of], flipped, np.abs(flipped)).max(axis=1)
        ranked = np.sort(largest)
        first = ranked if first is None else first
        weighed[of] = _share_beyond(ranked, observed[of]) / family.share
        np.minimum(smallest, _share_beyond(ranked, largest) / family.share, out=smallest)
    ranked = np.sort(smallest)
    p_value = (1.0 + np.searchsorted(ranked, weighed + 1e-12, side="right")) / (FLIPS + 1.0)
    return FlipTest(observed, np.asarray(p_value), np.zeros(1) if first is None else first, ranked)


def _share_beyond(ranked: FloatArray, statistic: FloatArray) -> FloatArray:
    """Return the share of flips whose largest statistic, in ``ranked`` order, reaches each statistic."""
    beyond = FLIPS - np.searchsorted(ranked, statistic - 1e-12, side="left")
    return np.asarray(np.maximum(beyond, 0.5) / FLIPS)
