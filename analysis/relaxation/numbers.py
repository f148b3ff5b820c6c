"""How a value and its error are written: to the second digit of the error, whatever their size."""

from __future__ import annotations

import math


def with_error(value: float, error: float | None) -> str:
    """Return value and error to the error's second digit, by powers of ten where they are very small or large."""
    if error is None or not 0 < error < math.inf:
        return f"{value:.4g}"
    size = max(abs(value), error)
    if 1e-3 <= size < 1e6:
        decimals = min(max(1 - math.floor(math.log10(error)), 0), 9)
        return f"{value:.{decimals}f} ± {error:.{decimals}f}"
    power = math.floor(math.log10(size))
    scale = 10.0**power
    decimals = min(max(1 - math.floor(math.log10(error / scale)), 0), 9)
    return f"({value / scale:.{decimals}f} ± {error / scale:.{decimals}f})e{power}"
