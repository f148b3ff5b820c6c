"""The tip moves on an arc, not on a line."""

from __future__ import annotations

import numpy as np

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values


class LeverArc(Mechanism):
    """Normal travel R sin(x/R); the recorded force is torque / R = F cos(x/R).

    The angle is zero at mid travel, or ``zero_mm`` beside it: an arm is mounted as well as that.
    """

    name = "lever_arc"
    stage = "lever"
    parameters = (
        Parameter("radius_mm", "mm", 5.0, 1.0e4, "inverse_square"),
        Parameter("zero_mm", "mm", -1.0, 1.0, inner=True),
    )
    amplitude = "radius_mm"
    null = {"radius_mm": 1.0e4, "zero_mm": 0.0}
    probes = ({"radius_mm": 60.0, "zero_mm": 0.0},)
    typical = {"radius_mm": 30.0, "zero_mm": 0.0}
    words = "the punch swings on an arc about the lever's pivot, so that travel and force change away from mid travel"
    source = "geometry of the lever"
    separated_by = "three surface heights"

    def applies(self, trial: CellTrial) -> bool:
        """On a lever arm only."""
        return trial.lever and super().applies(trial)

    def tip_mm(self, trial: CellTrial, tip_mm: FloatArray, force_mn: FloatArray, p: Values) -> FloatArray:
        """Normal travel on the arc."""
        travel, radius = self._travel_mm(trial, p), p["radius_mm"]
        return tip_mm + (radius * np.sin(travel / radius) - travel)

    def sensor_force_mn(self, trial: CellTrial, force_mn: FloatArray, p: Values) -> FloatArray:
        """Torque divided by the arm's length."""
        return np.asarray(force_mn * np.cos(self._travel_mm(trial, p) / p["radius_mm"]))

    @staticmethod
    def _travel_mm(trial: CellTrial, p: Values) -> FloatArray:
        """Return how far (n,) the arm is from where its angle is zero, mm."""
        return trial.angle_travel_mm - p.get("zero_mm", 0.0)
