"""Warm skin heats the punch and the sensor behind it."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import Effect, Parameter
from sim_hardware.filters import one_pole
from sim_hardware.parts import SAMPLE_RATE_HZ, Block, FloatArray


class WarmTouch(Effect):
    """The sensor's zero moves as the punch warms in contact, and back as it cools: whatever the depth.

    Shows from the dwell on, after contact as well. Rough: it warms twice as fast as it cools.
    """

    name = "warm_touch"
    stage = "sensor"
    in_library = False
    phases = ("approach", "dwell", "ramp", "hold", "retract", "clear")
    parameters = (
        Parameter("zero_mn", "mN", 3.0, -50.0, 50.0, "how far the zero moves in the end"),
        Parameter("time_constant_s", "s", 1.5, 0.05, 1000.0, "time of the cooling"),
    )
    warm = 0.0

    def sense(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Move the zero."""
        if not len(force_mn):
            return force_mn
        touching = block.skin & (block.contact_force_mn != 0)
        warmth = np.empty_like(force_mn)
        edges = [0, *(np.flatnonzero(np.diff(touching)) + 1).tolist(), len(touching)]
        for start, stop in zip(edges[:-1], edges[1:], strict=True):
            on = bool(touching[start])
            time_s = self["time_constant_s"] / (1 + self.rough * on)
            keep = float(np.exp(-1 / (time_s * SAMPLE_RATE_HZ)))
            warmth[start:stop] = one_pole(keep, np.full(stop - start, (1 - keep) * on), self.warm)
            self.warm = float(warmth[stop - 1])
        return force_mn + self["zero_mn"] * warmth

    def rest(self, duration_s: float) -> None:
        """Cool."""
        self.warm *= float(np.exp(-duration_s / self["time_constant_s"]))
