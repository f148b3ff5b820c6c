"""The card's converters: 16 bits over +-10 V, clipped at the ends."""

from __future__ import annotations

import numpy as np

from sim_hardware.parts import FloatArray
from sim_hardware.settings import ConverterSettings


class Converter:
    """A converter of so many bits; with 0 bits it passes volts through, clipped."""

    def __init__(self, settings: ConverterSettings) -> None:
        self._range_v = settings.range_v
        self._half = 2.0 ** (settings.bits - 1) if settings.bits else 0.0

    @property
    def step_v(self) -> float:
        """Size of one code, V (0 for an ideal converter)."""
        return self._range_v / self._half if self._half else 0.0

    def codes(self, volts: FloatArray) -> FloatArray:
        """Return the codes of some volts: whole numbers, or volts where the converter is ideal."""
        if not self._half:
            return np.clip(volts, -self._range_v, self._range_v)
        return np.clip(np.rint(volts * (self._half / self._range_v)), -self._half, self._half - 1)

    def volts(self, codes: FloatArray) -> FloatArray:
        """Return the volts that codes stand for."""
        return codes * self.step_v if self._half else codes

    def convert(self, volts: FloatArray) -> FloatArray:
        """Return volts as they are after conversion."""
        return self.volts(self.codes(volts))
