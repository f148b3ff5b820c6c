"""How well the other trials predict each one: evidence that no fitted coefficient can flatter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.fit.gram import Grams, solve
from analysis.mismatch.model.effects import TISSUE_SIZE

FloatArray = NDArray[np.float64]

FEWEST_HELD_OUT = 3


def heldout_deviance(grams: Grams, added: Sequence[int]) -> FloatArray:
    """Return each trial's deviance (n,) at the coefficients that the other trials give (leave one trial out).

    ``added`` are the columns used beside the population's mean. Of fewer than three trials none can be held out: there
    the fitted deviance is raised by ln(cells) for every column (Schwarz 1978).
    """
    pick = [*range(TISSUE_SIZE), *(TISSUE_SIZE + k for k in added)]
    total = grams.total()
    found = np.zeros(len(grams.by_trial))
    few = len(found) < FEWEST_HELD_OUT
    for j, G in enumerate(grams.by_trial):
        b, _ = solve(total if few else total - G, grams.ridge, pick)
        found[j] = G[-1, -1] - 2.0 * b @ G[pick, -1] + b @ G[np.ix_(pick, pick)] @ b
    if few:
        found += len(added) * np.log(grams.n_cells) / len(found)
    return found
