"""What an effect of unknown size explains, its size integrated out."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def log_ratio(a: FloatArray | float, c2: FloatArray, v: FloatArray | float) -> FloatArray:
    """Return ln of the likelihood with an effect over that without, all of one shape: the Bayes factor of a line.

    Its coefficient is normal about zero with variance ``v``, of information ``a`` and squared score ``c2``.
    """
    return np.asarray(-0.5 * np.log1p(v * a) + 0.5 * v * c2 / (1.0 + v * a))
