"""Dry friction in the bearing."""

from __future__ import annotations

import numpy as np

from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values
from analysis.simulation.cells import CellTrial


class CoulombFriction(Mechanism):
    """F gains Fc sign(dx/dt).

    The sign is smoothed over ``onset_mm_s``, so that a resting arm's last microns do not flip it.
    """

    name = "coulomb_friction"
    stage = "sensor"
    parameters = (
        Parameter("force_mn", "mN", 0.0, 1.0e6),
        Parameter("onset_mm_s", "mm/s", 0.005, 2.0, "log", inner=True),
    )
    amplitude = "force_mn"
    null = {"force_mn": 0.0, "onset_mm_s": 0.03}
    probes = ({"force_mn": 0.1, "onset_mm_s": 0.03},)
    typical = {"force_mn": 1.0, "onset_mm_s": 0.03}
    needs_contact = False
    in_air = True
    words = "dry friction in the bearing: a force that opposes motion and does not depend on its speed"
    source = "Coulomb's law"
    separated_by = "air_sweep"

    def sensor_force_mn(self, trial: CellTrial, force_mn: FloatArray, p: Values) -> FloatArray:
        """F + Fc sign(v)."""
        return np.asarray(force_mn + p["force_mn"] * np.tanh(trial.velocity_mm_s / p["onset_mm_s"]))
