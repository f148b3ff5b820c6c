"""How a value and its error are written: to the digits that the error leaves, whatever their size."""

from __future__ import annotations

import math


def concise(value: float, error: float | None) -> str:
    """Return value and, in brackets, its error to one digit in units of the last: 2.28(4) is 2.28 ± 0.04.

    One digit of the error, so that a table of a trial's constants fits a terminal of 80 columns.
    """
    if error is None or not 0 < error < math.inf:
        return f"{value:.4g}"
    power = math.floor(math.log10(max(abs(value), error)))
    scale = 1.0 if -3 <= power < 6 else 10.0**power
    suffix = "" if scale == 1.0 else f"e{power}"
    decimals = min(max(-math.floor(math.log10(error / scale)), 0), 9)
    return f"{value / scale:.{decimals}f}({round(error / scale * 10**decimals)}){suffix}"


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
