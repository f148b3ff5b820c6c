"""What may stand in a trial file: each check says what is wrong with a value, or nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from datetime import datetime
from typing import Any

import numpy as np

from analysis.recordings.trial import PHASE_NAMES, FloatArray, Phase

Check = Callable[[Any], str | None]
"""Returns what is wrong with a value, or None."""

_LARGEST = 1e9  # beyond it, in whatever unit, a value is damage: later arithmetic need not guard itself


def one_of(allowed: Iterable[Any]) -> Check:
    """Return a check that a value is one of those allowed."""
    names = tuple(allowed)

    def check(value: Any) -> str | None:
        return None if value in names else f"must be one of {', '.join(str(name) for name in names)}"

    return check


def finite(value: float) -> str | None:
    """Check that a number is finite and of a size that can be calculated with."""
    return None if abs(value) <= _LARGEST else "must be a finite number of sensible size"


def slope(value: float) -> str | None:
    """Check that a calibration slope can be divided by."""
    sensible = 1 / _LARGEST <= abs(value) <= _LARGEST
    return None if sensible else "must be a finite number of sensible size, and not zero"


def positive(value: float) -> str | None:
    """Check that a number is finite and above zero."""
    return None if 1 / _LARGEST <= value <= _LARGEST else "must be a finite number above zero"


def not_negative(value: float) -> str | None:
    """Check that a number is finite and not below zero."""
    return None if 0 <= value <= _LARGEST else "must be a finite number, not negative"


def moment(value: str) -> str | None:
    """Check that a text is a date and time of ISO 8601."""
    try:
        datetime.fromisoformat(value)
    except ValueError:
        return "must be a date and time as 2026-01-31T12:00:00+01:00"
    return None


def filled(value: str) -> str | None:
    """Check that a text says something."""
    return None if value.strip() else "must not be empty"


def samples_problem(array: FloatArray) -> str | None:
    """Say which sample is not finite or not of a size that can be calculated with."""
    # the extremes of an array with a NaN are NaN, so that no array of flags is needed for a good one
    if len(array) == 0 or not (finite(float(array.min())) or finite(float(array.max()))):
        return None
    bad = np.flatnonzero(~(np.abs(array) <= _LARGEST))
    return f"is {array[bad[0]]} at sample {bad[0]} ({bad.size} such)"


def phases_problem(phases: Sequence[Phase], n_samples: int) -> str | None:
    """Say which phase has an unknown name, is out of order or leaves the recording."""
    earliest = 0
    for number, phase in enumerate(phases):
        if phase.name not in PHASE_NAMES:
            return f"row {number} is named {phase.name!r:.40}, known are {', '.join(PHASE_NAMES)}"
        if not earliest <= phase.start <= phase.stop <= n_samples:
            return (
                f"row {number} ({phase.name}) runs from {phase.start} to {phase.stop}, "
                f"it must lie between {earliest} and {n_samples}"
            )
        earliest = phase.stop
    return None
