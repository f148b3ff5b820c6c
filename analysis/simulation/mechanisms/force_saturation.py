"""The force channel bends or is cut above a level."""

from __future__ import annotations

import numpy as np
from numba import njit

from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values

FAR = 40.0
"""Knees from the level beyond which a rounded corner is none to any digit."""


@njit(cache=True)
def _over(bent_mn: FloatArray, level_mn: float, knee: float) -> FloatArray:
    """Return knee ln(1 + exp((F - level) / knee)) (n,), sooner than `logaddexp`: most is far from it."""
    over = np.empty_like(bent_mn)
    for i in range(len(bent_mn)):
        above = (bent_mn[i] - level_mn) / knee
        corner = np.log1p(np.exp(-abs(above))) if abs(above) < FAR else 0.0
        over[i] = knee * (max(above, 0.0) + corner)
    return over


class ForceSaturation(Mechanism):
    """F above ``level_mn`` keeps only the share ``slope_above`` of its rise (0: cut), within a share ``knee`` of it.

    F is what the channel reads, with the share ``with_offset`` of the trial's offset: with all of it in the textbook's,
    as what drifts is the transducer; with none where a converter's own zero is off.
    """

    name = "force_saturation"
    stage = "sensor"
    parameters = (
        Parameter("level_mn", "mN", 1e-9, 1.0e9, "log"),
        Parameter("slope_above", "1", 0.0, 0.98, inner=True),
        Parameter("knee", "1", 2e-4, 1.0, "log", inner=True),
        Parameter("with_offset", "1", 0.0, 1.0, inner=True),
    )
    amplitude = "level_mn"
    null = {"level_mn": 1.0e9, "slope_above": 0.0, "knee": 0.01, "with_offset": 1.0}
    words = "the force channel runs out of range: readings above a level are bent or cut"
    source = "converter and amplifier range"
    separated_by = "smaller depth"

    def probe_settings(self, peak_force_mn: float, depth_mm: float) -> tuple[Values, ...]:
        """Levels below the largest force of the recordings."""
        shares = (0.5, 0.65, 0.8, 0.9, 0.95, 0.98, 0.99)
        return tuple(
            {"level_mn": share * peak_force_mn, "slope_above": 0.9, "knee": 0.01, "with_offset": 1.0}
            for share in shares
        )

    def unread_mn(self, force_mn: FloatArray, offset_mn: float, p: Values) -> FloatArray:
        """What F loses above the level."""
        knee = p["knee"] * p["level_mn"]
        bent_mn = force_mn + p.get("with_offset", 1.0) * offset_mn
        over = _over(bent_mn.reshape(-1), p["level_mn"], knee).reshape(bent_mn.shape)
        return np.asarray((1.0 - p["slope_above"]) * over)
