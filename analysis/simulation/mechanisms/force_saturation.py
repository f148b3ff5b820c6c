"""The force channel bends or is cut above a level."""

from __future__ import annotations

import numpy as np

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values


class ForceSaturation(Mechanism):
    """F above ``level_mn`` keeps only the share ``slope_above`` of its rise (0: cut), within a share ``knee`` of it.

    F is what the channel reads, the trial's offset with it: that is what has a range.
    """

    name = "force_saturation"
    stage = "sensor"
    parameters = (
        Parameter("level_mn", "mN", 1e-9, 1.0e9, "log"),
        Parameter("slope_above", "1", 0.0, 0.98, inner=True),
        Parameter("knee", "1", 2e-4, 1.0, "log", inner=True),
    )
    amplitude = "level_mn"
    null = {"level_mn": 1.0e9, "slope_above": 0.0, "knee": 0.01}
    of_reading = True
    words = "the force channel runs out of range: readings above a level are bent or cut"
    source = "converter and amplifier range"
    separated_by = "smaller depth"

    def probe_settings(self, peak_force_mn: float, depth_mm: float) -> tuple[Values, ...]:
        """Levels below the largest force of the recordings."""
        shares = (0.5, 0.65, 0.8, 0.9, 0.95, 0.98, 0.99)
        return tuple(
            {"level_mn": share * peak_force_mn, "slope_above": 0.9, "knee": 0.01} for share in shares
        )

    def sensor_force_mn(self, trial: CellTrial, force_mn: FloatArray, p: Values) -> FloatArray:
        """F bent above the level."""
        knee = p["knee"] * p["level_mn"]
        over = knee * np.logaddexp(0.0, (force_mn - p["level_mn"]) / knee)
        return np.asarray(force_mn - (1.0 - p["slope_above"]) * over)
