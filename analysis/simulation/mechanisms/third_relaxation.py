"""A third relaxation time."""

from __future__ import annotations

import numpy as np

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Tissue, Tissues, Values
from analysis.simulation.response import arm_force


class ThirdRelaxation(Mechanism):
    """A third Maxwell arm: stiffness ratio * k0, time constant of its own."""

    name = "third_relaxation"
    stage = "tissue"
    of_site = ("ratio_to_k0", "time_constant_s")
    parameters = (
        Parameter("ratio_to_k0", "1", 0.0, 20.0),
        Parameter("time_constant_s", "s", 1e-3, 300.0, "log"),
    )
    amplitude = "ratio_to_k0"
    null = {"ratio_to_k0": 0.0, "time_constant_s": 1.0}
    probes = tuple({"ratio_to_k0": 0.01, "time_constant_s": float(t)} for t in np.geomspace(3e-3, 60.0, 12))
    typical = {"ratio_to_k0": 0.1, "time_constant_s": 0.02}
    words = "the tissue relaxes with a third time constant that the two arms of the model do not have"
    source = "Maxwell-Weichert solid with three arms"
    separated_by = "a longer hold, a second punch radius"
    relaxes = True
    inseparable = ("poroelastic_drainage",)

    def exchanged(self, tissue: Tissue, p: Values, arm: int) -> tuple[Tissue, Values]:
        """Return the tissue with the third arm for one of its own, which becomes the third."""
        third = (p["ratio_to_k0"] * tissue.k0, p["time_constant_s"])
        arms = [(tissue.k1, tissue.tau1), (tissue.k2, tissue.tau2)]
        k, tau = arms[arm - 1]
        arms[arm - 1] = third
        (k2, tau2), (k1, tau1) = sorted(arms, key=lambda a: a[1])
        return Tissue(tissue.k0, k1, tau1, k2, tau2), {"ratio_to_k0": k / tissue.k0, "time_constant_s": tau}

    def tissue_force_mn(
        self, trial: CellTrial, depth_mm: FloatArray, tissue: Tissue | Tissues, p: Values
    ) -> FloatArray:
        """Force of the third arm."""
        return p["ratio_to_k0"] * tissue.k0 * arm_force(depth_mm, trial.steps, p["time_constant_s"])
