"""What is known of a stiff block before it is pressed: it yields, but by no more than the least stiff block does.

A block that yields and a lever that bends are two springs in series, so that no trial on the block tells one from the
other; only that a block is 1e4 mN/mm or stiffer does. Its compliance is taken as anywhere between that and none.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.simulation.forward import RIGID_STIFFNESS_MN_PER_MM

FloatArray = NDArray[np.float64]

BLOCK_PARAMETER = "target_stiffness_mn_per_mm"
MOST_MM_PER_MN = 1.0 / RIGID_STIFFNESS_MN_PER_MM


def block_information(
    names: Sequence[str], stiffness_mn_per_mm: float
) -> tuple[FloatArray, FloatArray, float]:
    """Return J'J (P, P), J'r (P,) and r^2 of what is known of a block's compliance, for shared parameters ``names``.

    The stiffness is fitted by its logarithm; a compliance uniform over its range has the variance of a twelfth of the
    range squared. All zero where no block's stiffness is fitted.
    """
    JJ, Jr = np.zeros((len(names), len(names))), np.zeros(len(names))
    if BLOCK_PARAMETER not in names:
        return JJ, Jr, 0.0
    k = names.index(BLOCK_PARAMETER)
    compliance, spread = 1.0 / stiffness_mn_per_mm, MOST_MM_PER_MN / np.sqrt(12.0)
    residual, slope = (0.5 * MOST_MM_PER_MN - compliance) / spread, -compliance / spread
    JJ[k, k], Jr[k] = slope**2, slope * residual
    return JJ, Jr, float(residual**2)
