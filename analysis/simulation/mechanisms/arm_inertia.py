"""The arm has mass: accelerating it shows as force."""

from __future__ import annotations

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values
from analysis.simulation.response import low_pass


class ArmInertia(Mechanism):
    """F gains m d2x/dt2 (1 g mm/s^2 = 1e-3 mN), smeared over ``settle_ms`` by the arm's own bending (0: rigid arm)."""

    name = "arm_inertia"
    stage = "sensor"
    parameters = (
        Parameter("mass_g", "g", 0.0, 1.0e6),
        Parameter("settle_ms", "ms", 0.01, 5.0, "log", inner=True),
    )
    amplitude = "mass_g"
    null = {"mass_g": 0.0, "settle_ms": 0.02}
    probes = ({"mass_g": 0.01, "settle_ms": 0.02}, {"mass_g": 0.01, "settle_ms": 0.4})
    typical = {"mass_g": 0.5, "settle_ms": 0.02}
    needs_contact = False
    words = (
        "the arm's own mass shows as force whenever it is accelerated, at the start and end of every motion"
    )
    source = "Newton's second law"
    separated_by = "air_sweep"

    def sensor_force_mn(self, trial: CellTrial, force_mn: FloatArray, p: Values) -> FloatArray:
        """F + m a."""
        felt = low_pass(trial.acceleration_mm_s2, trial.steps, 1e-3 * p["settle_ms"])
        return force_mn + 1e-3 * p["mass_g"] * felt
