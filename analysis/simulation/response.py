"""Relaxing answers to a motion given on uneven cells, built from the Maxwell arm."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.relaxation.response import arm_response

FloatArray = NDArray[np.float64]


def low_pass(force: FloatArray, time_s: FloatArray, time_constant_s: float) -> FloatArray:
    """Return a piecewise-linear signal (n,) after a first-order low-pass, exact: T y' + y = F."""
    if time_constant_s <= 0:
        return force
    return force - arm_response(force, time_s, time_constant_s)


def spectrum_force(
    drive: FloatArray, time_s: FloatArray, taus_s: FloatArray, weights: FloatArray
) -> FloatArray:
    """Return the force of many arms (m,) of given times and stiffnesses in parallel."""
    total = np.zeros_like(drive)
    for tau_s, weight in zip(taus_s, weights, strict=True):
        total += weight * arm_response(drive, time_s, float(tau_s))
    return total
