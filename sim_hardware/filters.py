"""Small recursive filters whose result does not depend on how the signal is cut into blocks."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from sim_hardware.parts import FloatArray


@njit(cache=True)
def one_pole(keep: float, drive: FloatArray, before: float) -> FloatArray:
    """Return y with y_i = keep y_(i-1) + drive_i, starting from ``before``."""
    out = np.empty_like(drive)
    y = before
    for i in range(drive.shape[0]):
        y = keep * y + drive[i]
        out[i] = y
    return out


@njit(cache=True)
def _resonance(c: FloatArray, signal: FloatArray, state: FloatArray) -> FloatArray:
    out = np.empty_like(signal)
    y1, y2 = state[0], state[1]
    for i in range(signal.shape[0]):
        y = c[0] * y1 + c[1] * y2 + c[2] * signal[i]
        y2, y1 = y1, y
        out[i] = y
    state[0], state[1] = y1, y2
    return out


class LowPass:
    """A first-order low-pass, exact for a signal that is linear between its points."""

    def __init__(self, time_constant_s: float, step_s: float) -> None:
        ratio = step_s / time_constant_s
        self._keep = math.exp(-ratio)
        mean = -math.expm1(-ratio) / ratio
        self._old, self._new = mean - self._keep, 1 - mean
        self._last: tuple[float, float] | None = None

    def __call__(self, signal: FloatArray) -> FloatArray:
        """Return the filtered signal; the first value ever seen is taken to have lasted for ever."""
        if not len(signal):
            return signal
        x, y = self._last or (float(signal[0]), float(signal[0]))
        drive = self._new * signal
        drive[0] += self._old * x
        drive[1:] += self._old * signal[:-1]
        out: FloatArray = one_pole(self._keep, drive, y)
        self._last = float(signal[-1]), float(out[-1])
        return out

    def settle(self) -> None:
        """Forget the past: the next value is taken to have lasted for ever."""
        self._last = None


class Resonance:
    """A second-order resonance of unit gain at zero frequency (impulse-invariant)."""

    def __init__(self, frequency_hz: float, damping_ratio: float, step_s: float) -> None:
        wn = 2 * math.pi * frequency_hz
        fall = math.exp(-damping_ratio * wn * step_s)
        swing = math.cos(wn * math.sqrt(1 - damping_ratio**2) * step_s)
        first, second = 2 * fall * swing, -(fall**2)
        self._c = np.array([first, second, 1 - first - second])
        self._state = np.zeros(2)

    def __call__(self, signal: FloatArray) -> FloatArray:
        """Return the filtered signal."""
        out: FloatArray = _resonance(self._c, signal, self._state)
        return out
