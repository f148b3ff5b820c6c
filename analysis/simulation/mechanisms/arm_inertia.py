"""The arm has mass: accelerating it shows as force."""

from __future__ import annotations

from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values
from analysis.simulation.cells import CellTrial


class ArmInertia(Mechanism):
    """F gains m d2x/dt2 (1 g mm/s^2 = 1e-3 mN)."""

    name = "arm_inertia"
    stage = "sensor"
    parameters = (Parameter("mass_g", "g", 0.0, 1.0e6),)
    amplitude = "mass_g"
    null = {"mass_g": 0.0}
    probes = ({"mass_g": 0.01},)
    typical = {"mass_g": 0.5}
    needs_contact = False
    in_air = True
    words = "the arm's own mass shows as force whenever it is accelerated, at the start and end of every motion"
    source = "Newton's second law"
    separated_by = "air_sweep"

    def sensor_force_mn(self, trial: CellTrial, force_mn: FloatArray, p: Values) -> FloatArray:
        """F + m a."""
        return force_mn + 1e-3 * p["mass_g"] * trial.acceleration_mm_s2
