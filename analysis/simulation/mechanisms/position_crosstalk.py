"""The force reading depends on where the arm is."""

from __future__ import annotations

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values


class PositionCrosstalk(Mechanism):
    """F gains g x: the arm's weight, the motor's spring; x counts from mid travel (the rest is offset)."""

    name = "position_crosstalk"
    stage = "sensor"
    parameters = (Parameter("gain_mn_per_mm", "mN/mm", -1.0e4, 1.0e4),)
    amplitude = "gain_mn_per_mm"
    null = {"gain_mn_per_mm": 0.0}
    probes = ({"gain_mn_per_mm": 0.05},)
    typical = {"gain_mn_per_mm": 1.0}
    one_sided = False
    needs_contact = False
    words = (
        "the force reading changes with the arm's position, touching or not "
        "(weight of the arm, spring of the motor)"
    )
    source = "gravity and restoring torque"
    separated_by = "air_sweep"

    def sensor_force_mn(self, trial: CellTrial, force_mn: FloatArray, p: Values) -> FloatArray:
        """F + g x."""
        return force_mn + p["gain_mn_per_mm"] * trial.angle_travel_mm
