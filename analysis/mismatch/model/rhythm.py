"""A quick rhythm of the surface, whose size and phase wander: tremor, or any narrow band."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]

HIGHEST_HZ = 15.0
HARMONIC = "harmonic"
"""Marks the shapes of the overtones of a rhythm that has too few cycles for a band."""
CYCLES = 1.25
"""No rhythm changes within a cycle or so."""
OVERTONES = {2: 0.3, 3: 0.15, 4: 0.1, 5: 0.07, 6: 0.05}
"""A body's rhythm is no sine: it has overtones of some such shares of its size."""


@dataclass(frozen=True)
class Rhythm:
    """A surface that oscillates in one trial, s = sum_k A_k(t) w_k(t), ``waves`` (n, K) the w of its frequency.

    The A_k are Ornstein-Uhlenbeck processes of variance ``size_mm``^2. Those of the frequency itself forget themselves
    in T = ``coherent_s``, a Lorentzian band about it, the phase free; overtones sooner. They are no parameters: the
    covariance of the force that they make is part of the noise that cells are weighed by, and what they came to is read
    from the residual.

    ``force_mn`` (n, K) is the change of force by each w_k times ``size_mm``, in a line about where the surface was
    found: ``found_mm`` (n,), by ``amplitudes`` (n, K) in units of the size. ``bent_mn`` (n,) is what the surface makes
    of the force there beyond that line.
    """

    effect: str
    frequency_hz: float
    size_mm: float
    coherent_s: float
    force_mn: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    amplitudes: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    found_mm: FloatArray = field(default_factory=lambda: np.zeros(0))
    bent_mn: FloatArray = field(default_factory=lambda: np.zeros(0))
    waves: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    @cached_property
    def passed_mn(self) -> FloatArray:
        """What the line makes of where the surface was found, (n,)."""
        return self.line_mn(self.amplitudes)

    def line_mn(self, amplitudes: FloatArray) -> FloatArray:
        """Return what the line makes of amplitudes (n, K), (n,)."""
        return np.asarray(np.sum(self.force_mn * amplitudes, axis=1))

    @property
    def waves_coherent_s(self) -> FloatArray:
        """For how long each wave (2N,) keeps its phase and size, s; none changes within a cycle or so.

        A rhythm a little off its frequency has its n-th overtone off by n times as much: its band is n times as wide.
        """
        number = np.array(list(overtones(self.frequency_hz)))
        own_s = np.maximum(self.coherent_s / number, CYCLES / (number * self.frequency_hz))
        return np.repeat(own_s, 2)

    @property
    def is_nothing(self) -> bool:
        """Whether it forgets itself within a cycle or so: what has no frequency is no rhythm."""
        return self.coherent_s * self.frequency_hz <= CYCLES * (1.0 + 1e-6)

    def of(self, larger: float, steadier: float) -> Rhythm:
        """Return the rhythm so much larger and steadier."""
        return replace(
            self,
            size_mm=larger * self.size_mm,
            coherent_s=steadier * self.coherent_s,
            force_mn=larger * self.force_mn,
            amplitudes=self.amplitudes / larger,
        )


def overtones(frequency_hz: float) -> dict[int, float]:
    """Return the numbers of a rhythm's overtones, the first its own, and their shares of its size."""
    return {1: 1.0} | {n: share for n, share in OVERTONES.items() if n * frequency_hz < HIGHEST_HZ}


def waves(trial: CellTrial, frequency_hz: float) -> FloatArray:
    """Return cosines and sines (n, 2N) of a rhythm and its overtones by their shares, averaged over the cells."""
    return np.hstack([share * sine(trial, n * frequency_hz) for n, share in overtones(frequency_hz).items()])


def sine(trial: CellTrial, frequency_hz: float) -> FloatArray:
    """Return cosine and sine (n, 2), averaged over the cells."""
    phase = 2.0 * np.pi * frequency_hz * trial.time_s
    return np.column_stack([np.cos(phase), np.sin(phase)]) * np.sinc(frequency_hz * trial.widths_s)[:, None]
