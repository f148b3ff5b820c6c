"""Friction that grows with speed."""

from __future__ import annotations

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values


class ViscousFriction(Mechanism):
    """F gains c dx/dt, contact or not."""

    name = "viscous_friction"
    stage = "sensor"
    parameters = (Parameter("coefficient_mn_s_per_mm", "mN s/mm", 0.0, 1.0e5),)
    amplitude = "coefficient_mn_s_per_mm"
    null = {"coefficient_mn_s_per_mm": 0.0}
    probes = ({"coefficient_mn_s_per_mm": 0.02},)
    typical = {"coefficient_mn_s_per_mm": 0.3}
    needs_contact = False
    words = "viscous friction in the lever: a force that opposes motion and grows with its speed, in contact or not"
    source = "linear damping"
    separated_by = "air_sweep"

    def sensor_force_mn(self, trial: CellTrial, force_mn: FloatArray, p: Values) -> FloatArray:
        """F + c v."""
        return force_mn + p["coefficient_mn_s_per_mm"] * trial.velocity_mm_s
