"""The force channel is slow."""

from __future__ import annotations

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values
from analysis.simulation.response import low_pass

MOST_SHARED = 2.0 / 3.0
"""At this share three poles are equal, which spread a step over as long as a moving average of twice their lag."""


class ForceLag(Mechanism):
    """F passes a low-pass that is late by T: (1 - q) T y' + y = F, and q T / 2 in the same way twice more.

    The textbook's has one pole, q = 0. Filters of instruments have more, and averages have none.
    """

    name = "force_lag"
    stage = "sensor"
    parameters = (
        Parameter("time_constant_ms", "ms", 0.0, 500.0),
        Parameter("shared", "1", 0.0, MOST_SHARED, inner=True),
    )
    amplitude = "time_constant_ms"
    null = {"time_constant_ms": 0.0, "shared": 0.0}
    probes = (
        {"time_constant_ms": 0.1, "shared": 0.0},
        {"time_constant_ms": 1.0, "shared": 0.0},
        {"time_constant_ms": 8.0, "shared": 0.0},
    )
    typical = {"time_constant_ms": 2.0, "shared": 0.0}
    sensor_rank = 1
    words = "the force channel answers late: a low-pass filter smears every quick change of force"
    source = "first-order filter; more of its poles after Butterworth's and Bessel's filters"
    separated_by = "rigid_target"

    def sensor_force_mn(self, trial: CellTrial, force_mn: FloatArray, p: Values) -> FloatArray:
        """F after the filter."""
        T, q = 1e-3 * p["time_constant_ms"], p.get("shared", 0.0)
        for pole_s in ((1.0 - q) * T, 0.5 * q * T, 0.5 * q * T):
            force_mn = low_pass(force_mn, trial.steps, pole_s)
        return force_mn
