"""Significance by sign-flips: trusts no noise model, only that noise is as likely to be turned round.

Hemerik, Goeman, Finos, J. R. Stat. Soc. B 82:841 (2020) (flips of score contributions, nuisance projected out),
with the maximum over all candidates (Westfall, Young 1993).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

FLIPS = 4999


@dataclass(frozen=True)
class FlipTest:
    """``statistic`` (M,) of each candidate and ``p_value`` (M,) over all candidates together."""

    statistic: FloatArray
    p_value: FloatArray


def flip_test(scores: FloatArray, one_sided: NDArray[np.bool_], rng: np.random.Generator) -> FlipTest:
    """Test score contributions (units, M) of M candidates by flipping the sign of whole units.

    The statistic is sum(s) / sqrt(sum(s^2)), its absolute value for two-sided candidates. Units are trials, or
    blocks of trials where there are few. The largest statistic of each flip counts.
    """
    size = np.sqrt((scores**2).sum(axis=0))
    unit = np.divide(scores, size, out=np.zeros_like(scores), where=size > 0)
    signs = rng.integers(0, 2, size=(FLIPS, len(scores))) * 2.0 - 1.0
    observed = unit.sum(axis=0)
    observed = np.where(one_sided, observed, np.abs(observed))
    flipped = signs @ unit
    largest = np.sort(np.where(one_sided, flipped, np.abs(flipped)).max(axis=1))
    beyond = FLIPS - np.searchsorted(largest, observed - 1e-12, side="left")
    return FlipTest(observed, np.asarray((1.0 + beyond) / (FLIPS + 1.0)))
