"""The force reading creeps."""

from __future__ import annotations

import numpy as np

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values

USUAL_S = 10.0
STRAIGHT_PER_S = 1e-9


class ForceDrift(Mechanism):
    """F gains rate * L (1 - exp(-b t)) / (1 - exp(-b L)), contact or not, with L = 10 s: rate is the mean over those.

    The textbook's is straight, rate * t, b = 0; what warms settles (b > 0).
    """

    name = "force_drift"
    stage = "sensor"
    parameters = (
        Parameter("rate_mn_per_s", "mN/s", -1.0e4, 1.0e4),
        Parameter("bends_per_s", "1/s", -0.1, 0.3, inner=True),
    )
    amplitude = "rate_mn_per_s"
    null = {"rate_mn_per_s": 0.0, "bends_per_s": 0.0}
    probes = ({"rate_mn_per_s": 0.01, "bends_per_s": 0.0},)
    typical = {"rate_mn_per_s": 0.1, "bends_per_s": 0.0}
    one_sided = False
    needs_contact = False
    words = "the force reading drifts slowly, touching or not (warming electronics, creeping gauge)"
    source = "linear drift; what warms or creeps comes to rest exponentially"
    separated_by = "air_sweep"

    def sensor_force_mn(self, trial: CellTrial, force_mn: FloatArray, p: Values) -> FloatArray:
        """F with the drift."""
        t, b = trial.time_s, p.get("bends_per_s", 0.0)
        gone = t if abs(b) < STRAIGHT_PER_S else USUAL_S * np.expm1(-b * t) / np.expm1(-b * USUAL_S)
        return np.asarray(force_mn + p["rate_mn_per_s"] * gone)
