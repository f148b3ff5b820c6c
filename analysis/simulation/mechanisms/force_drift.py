"""The force reading creeps."""

from __future__ import annotations

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values


class ForceDrift(Mechanism):
    """F gains rate * t, contact or not."""

    name = "force_drift"
    stage = "sensor"
    parameters = (Parameter("rate_mn_per_s", "mN/s", -1.0e4, 1.0e4),)
    amplitude = "rate_mn_per_s"
    null = {"rate_mn_per_s": 0.0}
    probes = ({"rate_mn_per_s": 0.01},)
    typical = {"rate_mn_per_s": 0.1}
    one_sided = False
    needs_contact = False
    words = "the force reading drifts slowly, touching or not (warming electronics, creeping gauge)"
    source = "linear drift"
    separated_by = "air_sweep"

    def sensor_force_mn(self, trial: CellTrial, force_mn: FloatArray, p: Values) -> FloatArray:
        """F + rate t."""
        return force_mn + p["rate_mn_per_s"] * trial.time_s
