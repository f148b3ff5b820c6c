"""A bit of the converter drops out."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import ALWAYS, Effect, Parameter
from sim_hardware.parts import Block, FloatArray


class DroppedBit(Effect):
    """Now and then a comparator misses a bit: codes that have it set read too low by its weight.

    Shows in every phase as single samples that are off by 2^bit codes, at random times, only at levels at
    which that bit is set. A code is 0.3 mV, 0.02 mN. An ideal converter has no bits to drop.
    """

    name = "dropped_bit"
    stage = "sensor"
    in_library = False
    phases = ALWAYS
    parameters = (
        Parameter("bit", "1", 8.0, 0.0, 14.0, "number of the bit, 0 the least"),
        Parameter("share", "1", 0.005, 0.0, 1.0, "share of the samples at which it drops"),
    )

    def digitise(self, block: Block, codes: FloatArray) -> FloatArray:
        """Drop the bit."""
        weight = 2.0 ** round(self["bit"])
        drops = self.random.random(len(codes)) < self["share"]
        is_set = np.floor(codes / weight) % 2 == 1
        return np.where(drops & is_set & (codes == np.rint(codes)), codes - weight, codes)
