"""Numbers as they are said: no digit that its error does not allow."""

from __future__ import annotations

from math import floor, isfinite, log10


def counted(n: int, what: str) -> str:
    """Write how many of something there are."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def with_error(value: float, error: float | None) -> str:
    """Write a value to the second digit of its error, where it has one."""
    if error is None or not isfinite(error) or not error > 0:
        return f"{value:.4g}"
    digits = max(0, 1 - floor(log10(error)))
    return f"{value:.{digits}f} ± {error:.{digits}f}"
