"""Commanded positions, sample by sample."""

from __future__ import annotations

import math

import numpy as np

from analysis.recordings.trial import FloatArray


def ramp_mm(start_mm: float, stop_mm: float, speed_mm_s: float, sample_rate_hz: float) -> FloatArray:
    """Return a straight ramp from `start_mm`, which is not repeated, to `stop_mm`, which is its last sample.

    Shape (n,), mm, n = distance / speed in samples, rounded up so that the speed is never exceeded; empty
    where there is nowhere to go.
    """
    distance = abs(stop_mm - start_mm)
    n = math.ceil(distance / speed_mm_s * sample_rate_hz - 1e-9)
    if n <= 0:
        return np.empty(0)
    waveform = start_mm + (stop_mm - start_mm) * np.arange(1, n + 1) / n
    waveform[-1] = stop_mm
    return waveform


def there_and_back_mm(from_mm: float, to_mm: float, speed_mm_s: float, sample_rate_hz: float) -> FloatArray:
    """Return a ramp from `from_mm` to `to_mm` and back again, (2n,), mm."""
    return np.concatenate(
        [
            ramp_mm(from_mm, to_mm, speed_mm_s, sample_rate_hz),
            ramp_mm(to_mm, from_mm, speed_mm_s, sample_rate_hz),
        ]
    )
