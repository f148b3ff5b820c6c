"""Fluid drains from under the punch."""

from __future__ import annotations

import numpy as np

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Tissue, Tissues, Values
from analysis.simulation.response import arm_force, arms_force

RATES = np.geomspace(0.03, 3e4, 14)
WEIGHTS = RATES**-0.5 * np.exp(-0.25 / RATES) * np.log(RATES[1] / RATES[0]) / (2.0 * np.sqrt(np.pi))
WEIGHTS[-1] += 1.0 - WEIGHTS.sum()
"""What each rate (in units of 1/T) has of exp(-sqrt(u)), on a logarithmic grid; the last has all that is quicker."""


class PoroelasticDrainage(Mechanism):
    """Relaxation 1.304 exp(-sqrt(t/T)) - 0.304 exp(-0.254 t/T) of stiffness ratio * k0 (Hu et al. 2010).

    exp(-sqrt(u)) = integral exp(-u s) s^(-3/2) exp(-1/(4 s)) / (2 sqrt(pi)) ds, summed on a logarithmic grid.
    """

    name = "poroelastic_drainage"
    stage = "tissue"
    of_site = ("ratio_to_k0", "time_constant_s")
    parameters = (
        Parameter("ratio_to_k0", "1", 0.0, 20.0),
        Parameter("time_constant_s", "s", 1e-3, 300.0, "log"),
    )
    amplitude = "ratio_to_k0"
    null = {"ratio_to_k0": 0.0, "time_constant_s": 1.0}
    probes = tuple({"ratio_to_k0": 0.01, "time_constant_s": float(t)} for t in np.geomspace(0.01, 60.0, 9))
    typical = {"ratio_to_k0": 0.1, "time_constant_s": 1.0}
    words = "fluid is pressed out from under the punch and drains away through the tissue"
    source = "Hu, Zhao, Vlassak, Suo, Appl. Phys. Lett. 96:121904 (2010), flat punch"
    separated_by = "a longer hold, a second punch radius"
    relaxes = True
    inseparable = ("third_relaxation",)

    def tissue_force_mn(
        self, trial: CellTrial, depth_mm: FloatArray, tissue: Tissue | Tissues, p: Values
    ) -> FloatArray:
        """Force of the draining fluid: it has further to go under a larger punch."""
        T = p["time_constant_s"] * trial.punch_ratio**2
        slow = arms_force(depth_mm, trial.steps, T / RATES, 1.304 * WEIGHTS)
        fast = 0.304 * arm_force(depth_mm, trial.steps, T / 0.254)
        return p["ratio_to_k0"] * tissue.k0 * (slow - fast)
