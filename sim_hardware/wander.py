"""Slow random wander as a function of time: the same whatever the blocks, and through any jump of time."""

from __future__ import annotations

import numpy as np

from sim_hardware.parts import FloatArray


class Wander:
    """A sum of sines of random phase, frequencies spread over a band; zero mean, unit rms."""

    def __init__(self, random: np.random.Generator, low_hz: float, high_hz: float, n: int = 5) -> None:
        self._rates = 2 * np.pi * (low_hz + (high_hz - low_hz) * (np.arange(n) + random.random(n)) / n)
        self._phases = 2 * np.pi * random.random(n)
        self._size = float(np.sqrt(2 / n))

    def __call__(self, time_s: FloatArray) -> FloatArray:
        """Return the wander at some times."""
        out = np.zeros_like(time_s)
        for rate, phase in zip(self._rates, self._phases, strict=True):
            out += np.sin(rate * time_s + phase)
        return self._size * out

    def integral(self, time_s: FloatArray) -> FloatArray:
        """Return an antiderivative of the wander, s: what a wandering frequency adds to a phase."""
        out = np.zeros_like(time_s)
        for rate, phase in zip(self._rates, self._phases, strict=True):
            out -= np.cos(rate * time_s + phase) / rate
        return self._size * out
