"""The arm has mass: accelerating it shows as force."""

from __future__ import annotations

import numpy as np

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values
from analysis.simulation.response import resonance

_TEXTBOOK = {"rings_ms": 0.02, "damping": 0.6, "shake_before": 0.0, "shake_after": 0.0}


class ArmInertia(Mechanism):
    """F gains m d2x/dt2 (1 g mm/s^2 = 1e-3 mN) as the arm's own bending passes it on (0: a rigid arm).

    That is a mass on a spring: it takes ``rings_ms``, one over its natural frequency, and rings by ``damping``.

    An output that steps pushes the arm once a sample, and the samples always meet the same moment of it: just before it
    steps, or just after. Of what the arm accelerates more then it passes on ``shake_before`` or ``shake_after`` (an
    output of lines: 0; of steps, to a rigid arm: 1), or some of either where it bends.
    """

    name = "arm_inertia"
    stage = "sensor"
    parameters = (
        Parameter("mass_g", "g", 0.0, 1.0e6),
        Parameter("rings_ms", "ms", 0.005, 5.0, "log", inner=True),
        Parameter("damping", "1", 0.03, 0.98, inner=True),
        Parameter("shake_before", "1", -0.5, 1.5, inner=True),
        Parameter("shake_after", "1", -0.5, 1.5, inner=True),
    )
    amplitude = "mass_g"
    null = {"mass_g": 0.0, **_TEXTBOOK}
    probes = (
        {"mass_g": 0.01, **_TEXTBOOK},
        {"mass_g": 0.01, **_TEXTBOOK, "rings_ms": 0.2, "damping": 0.9},
        {"mass_g": 0.01, **_TEXTBOOK, "rings_ms": 0.4, "damping": 0.2},
    )
    typical = {"mass_g": 0.5, **_TEXTBOOK}
    needs_contact = False
    words = (
        "the arm's own mass shows as force whenever it is accelerated, at the start and end of every motion"
    )
    source = "Newton's second law"
    separated_by = "air_sweep"

    def sensor_force_mn(self, trial: CellTrial, force_mn: FloatArray, p: Values) -> FloatArray:
        """F + m a."""
        shaken = trial.shake_mm_s2 @ np.array([p["shake_before"], p["shake_after"]])
        felt = resonance(trial.acceleration_mm_s2, trial.steps, 1e-3 * p["rings_ms"], p["damping"])
        return np.asarray(force_mn + 1e-3 * p["mass_g"] * (felt + shaken))
