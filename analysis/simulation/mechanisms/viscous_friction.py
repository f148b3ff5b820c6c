"""Friction that grows with speed."""

from __future__ import annotations

import numpy as np

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values
from analysis.simulation.response import low_pass

_TEXTBOOK = {"elastic": 0.0, "settle_ms": 5.0}


class ViscousFriction(Mechanism):
    """F gains c dx/dt, contact or not; a share ``elastic`` of it within ``settle_ms``, as a grease does (Jeffreys)."""

    name = "viscous_friction"
    stage = "sensor"
    parameters = (
        Parameter("coefficient_mn_s_per_mm", "mN s/mm", 0.0, 1.0e5),
        Parameter("elastic", "1", 0.0, 1.0, inner=True),
        Parameter("settle_ms", "ms", 0.5, 50.0, "log", inner=True),
    )
    amplitude = "coefficient_mn_s_per_mm"
    null = {"coefficient_mn_s_per_mm": 0.0, **_TEXTBOOK}
    probes = (
        {"coefficient_mn_s_per_mm": 0.02, **_TEXTBOOK},
        {"coefficient_mn_s_per_mm": 0.02, **_TEXTBOOK, "elastic": 0.7},
    )
    typical = {"coefficient_mn_s_per_mm": 0.3, **_TEXTBOOK}
    needs_contact = False
    words = "viscous friction in the lever: a force that opposes motion and grows with its speed, in contact or not"
    source = "linear damping; a grease that gives after Jeffreys (1929)"
    separated_by = "air_sweep"

    def sensor_force_mn(self, trial: CellTrial, force_mn: FloatArray, p: Values) -> FloatArray:
        """F + c v, a share of it after a low-pass."""
        drag, elastic = trial.velocity_mm_s, p.get("elastic", 0.0)
        if elastic:
            drag = drag + elastic * (low_pass(drag, trial.steps, 1e-3 * p["settle_ms"]) - drag)
        return np.asarray(force_mn + p["coefficient_mn_s_per_mm"] * drag)
