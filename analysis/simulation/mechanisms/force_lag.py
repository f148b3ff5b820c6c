"""The force channel is slow."""

from __future__ import annotations

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values
from analysis.simulation.response import low_pass


class ForceLag(Mechanism):
    """F passes a first-order low-pass: T y' + y = F."""

    name = "force_lag"
    stage = "sensor"
    parameters = (Parameter("time_constant_ms", "ms", 0.0, 500.0),)
    amplitude = "time_constant_ms"
    null = {"time_constant_ms": 0.0}
    probes = ({"time_constant_ms": 0.1}, {"time_constant_ms": 1.0}, {"time_constant_ms": 8.0})
    typical = {"time_constant_ms": 2.0}
    sensor_rank = 1
    words = "the force channel answers late: a low-pass filter smears every quick change of force"
    source = "first-order filter"
    separated_by = "rigid_target"

    def sensor_force_mn(self, trial: CellTrial, force_mn: FloatArray, p: Values) -> FloatArray:
        """F after the filter."""
        return low_pass(force_mn, trial.steps, 1e-3 * p["time_constant_ms"])
