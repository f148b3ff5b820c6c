"""Sparks on the force line."""

from __future__ import annotations

import numpy as np

from sim_hardware.effects.base import ALWAYS, Effect, Parameter
from sim_hardware.parts import SAMPLE_RATE_HZ, Block, FloatArray

_LONGEST_S = 600.0


class ForceSpikes(Effect):
    """Single samples of the force are far off, at random times and of either sign.

    Shows everywhere, contact or not. Rough: heights differ (exponentially), and one spike in three rings into
    the next samples. Textbook: all alike, one sample each.
    """

    name = "force_spikes"
    stage = "sensor"
    in_library = False
    phases = ALWAYS
    order = 80
    parameters = (
        Parameter("height_mn", "mN", 6.0, 0.0, 200.0, "mean height"),
        Parameter("rate_hz", "Hz", 1.0, 0.01, 100.0, "spikes per second"),
    )

    def begin_trial(self, trial: int) -> None:
        """Draw when and how high."""
        n = max(int(_LONGEST_S * self["rate_hz"]), 1)
        self.samples = np.cumsum(
            1 + np.floor(self.random.exponential(SAMPLE_RATE_HZ / self["rate_hz"], n))
        ).astype(np.int64)
        size = self.random.exponential(1.0, n) if self.rough else np.ones(n)
        self.heights = self["height_mn"] * size * self.random.choice([-1.0, 1.0], n)
        self.rings = self.rough * 0.5 * (self.random.random(n) < 1 / 3)

    def sense(self, block: Block, force_mn: FloatArray) -> FloatArray:
        """Add the spikes."""
        sample = np.rint(block.trial_time_s * SAMPLE_RATE_HZ).astype(np.int64)
        out = force_mn.copy()
        for late in range(3):
            at = np.minimum(np.searchsorted(self.samples, sample - late), len(self.samples) - 1)
            hit = (self.samples[at] == sample - late) & (block.trial_time_s >= 0)
            out += np.where(hit, self.heights[at] * (-self.rings[at]) ** late, 0.0)
        return out
