"""Noise of the sensors: white or heavy-tailed, correlated, 1/f, wandering, and a gain that differs by trial."""

from __future__ import annotations

import math

import numpy as np

from sim_hardware.filters import one_pole
from sim_hardware.parts import SAMPLE_RATE_HZ, FloatArray
from sim_hardware.settings import NoiseSettings

_ONE_OVER_F_HZ = (0.02, 200.0)
_PER_DECADE = 2


class _Wander:
    """Gaussian noise of a given rms and correlation time (Ornstein-Uhlenbeck), sample by sample."""

    def __init__(self, rms: float, time_s: float, random: np.random.Generator) -> None:
        self._rms, self._time_s, self._random = rms, time_s, random
        self._keep = math.exp(-1 / (time_s * SAMPLE_RATE_HZ))
        self._last = rms * float(random.standard_normal())

    def draw(self, n: int) -> FloatArray:
        drive = self._random.standard_normal(n) * (self._rms * math.sqrt(1 - self._keep**2))
        out: FloatArray = one_pole(self._keep, drive, self._last)
        if n:
            self._last = float(out[-1])
        return out

    def rest(self, duration_s: float) -> None:
        keep = math.exp(-duration_s / self._time_s)
        self._last = keep * self._last + self._rms * math.sqrt(1 - keep**2) * float(
            self._random.standard_normal()
        )


def _one_over_f(rms: float, random: np.random.Generator) -> list[_Wander]:
    """Return wanders of equal power whose corners stand evenly on the logarithm: their sum falls as 1/f."""
    low, high = _ONE_OVER_F_HZ
    corners = np.geomspace(low, high, round(_PER_DECADE * math.log10(high / low)) + 1)
    share = rms / math.sqrt(len(corners))
    return [
        _Wander(share, 1 / (2 * math.pi * f), own)
        for f, own in zip(corners, random.spawn(len(corners)), strict=True)
    ]


class SensorNoise:
    """Noise of both sensors; every stream has a generator of its own, so blocks of any size agree."""

    def __init__(self, settings: NoiseSettings, seed: int) -> None:
        streams = [np.random.default_rng([seed, 2, i]) for i in range(6)]
        self._position_mm = settings.position_um_rms * 1e-3
        share = settings.correlated_share
        self._white_mn = settings.force_mn_rms * math.sqrt(1 - share)
        self._tails = settings.tail_degrees_of_freedom
        self._gain_jitter = settings.gain_jitter
        self._force_random, self._position_random, self._trial_random = streams[:3]
        self._slow = [
            _Wander(rms, time_s, random)
            for rms, time_s, random in (
                (settings.force_mn_rms * math.sqrt(share), settings.correlation_ms * 1e-3, streams[3]),
                (settings.wander_mn_rms, settings.wander_time_s, streams[4]),
            )
            if rms > 0
        ]
        if settings.one_over_f_mn_rms > 0:
            self._slow += _one_over_f(settings.one_over_f_mn_rms, streams[5])
        self.gain = 1.0

    def begin_trial(self) -> None:
        """Draw this trial's gain of the force."""
        self.gain = 1.0 + self._gain_jitter * float(self._trial_random.standard_normal())

    def force_mn(self, n: int) -> FloatArray:
        """Noise of the force, (n,), mN."""
        if self._tails:
            to_unit = math.sqrt((self._tails - 2) / self._tails)
            noise = self._force_random.standard_t(self._tails, n) * (self._white_mn * to_unit)
        else:
            noise = self._force_random.standard_normal(n) * self._white_mn
        for wander in self._slow:
            noise += wander.draw(n)
        return noise

    def position_mm(self, n: int) -> FloatArray:
        """Noise of the position, (n,), mm."""
        return self._position_random.standard_normal(n) * self._position_mm

    def rest(self, duration_s: float) -> None:
        """Let the slow noise wander on while nothing is recorded."""
        for wander in self._slow:
            wander.rest(duration_s)
