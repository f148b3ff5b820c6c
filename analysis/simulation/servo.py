"""The lever's position servo: how the arm follows its command."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter, ss2tf

FloatArray = NDArray[np.float64]

DEFAULT_NATURAL_FREQUENCY_RAD_S = 5.0e3
DEFAULT_DAMPING_RATIO = 1.0


@dataclass(frozen=True, slots=True)
class ServoMotion:
    """Position (mm), velocity (mm/s) and acceleration (mm/s^2) of the arm, each (N,)."""

    position_mm: FloatArray
    velocity_mm_s: FloatArray
    acceleration_mm_s2: FloatArray


def follow(
    command_mm: FloatArray,
    sample_rate_hz: float,
    natural_frequency_rad_s: float = DEFAULT_NATURAL_FREQUENCY_RAD_S,
    damping_ratio: float = DEFAULT_DAMPING_RATIO,
    *,
    held: bool = False,
) -> ServoMotion:
    """Return the motion of a second-order servo that starts at rest on the first command.

    x'' = wn^2 (u - x) - 2 zeta wn x', integrated exactly for a command (N,) that is linear between samples, or
    ``held`` from sample to sample as a card plays it: what is sampled then is what the command before has done.
    """
    numerators, denominator = _filters(sample_rate_hz, natural_frequency_rad_s, damping_ratio, held)
    u = command_mm - command_mm[0]
    x, v, acceleration = (lfilter(row, denominator, u) for row in numerators)
    return ServoMotion(x + command_mm[0], v, acceleration)


@lru_cache(maxsize=64)
def _filters(sample_rate_hz: float, wn: float, zeta: float, held: bool) -> tuple[FloatArray, FloatArray]:
    """Return numerators (3, k) of position, velocity and acceleration, and their denominator (k,), of a servo.

    One is found for many stretches of command: it takes longer than to go through any of them.
    """
    a = np.array([[0.0, 1.0], [-wn * wn, -2.0 * zeta * wn]])
    b = np.array([[0.0], [wn * wn]])
    c = np.array([[1.0, 0.0], [0.0, 1.0], [-wn * wn, -2.0 * zeta * wn]])
    d = np.array([[0.0], [0.0], [wn * wn]])
    ad, bd, cd, dd, _ = cont2discrete((a, b, c, d), 1.0 / sample_rate_hz, method="zoh" if held else "foh")
    if held:
        # with the command before as a third state, what is sampled knows nothing of the command that begins
        ad, bd = np.block([[ad, np.zeros((2, 1))], [np.zeros((1, 3))]]), np.vstack([bd, [[1.0]]])
        cd, dd = np.hstack([cd, dd]), np.zeros_like(dd)
    numerators, denominator = ss2tf(ad, bd, cd, dd)
    for found in (numerators, denominator):
        found.flags.writeable = False
    return numerators, denominator
