"""The tissue resists the speed of indentation."""

from __future__ import annotations

import numpy as np

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Tissue, Values
from analysis.simulation.response import low_pass


class ParallelDashpot(Mechanism):
    """F_t gains c dd/dt while in contact, within ``settle_ms`` where a spring is in series with it (0: none)."""

    name = "parallel_dashpot"
    stage = "tissue"
    of_site = True
    parameters = (
        Parameter("coefficient_mn_s_per_mm", "mN s/mm", 0.0, 1.0e4),
        Parameter("settle_ms", "ms", 0.01, 5.0, "log", inner=True),
    )
    amplitude = "coefficient_mn_s_per_mm"
    null = {"coefficient_mn_s_per_mm": 0.0, "settle_ms": 0.05}
    probes = (
        {"coefficient_mn_s_per_mm": 0.02, "settle_ms": 0.05},
        {"coefficient_mn_s_per_mm": 0.02, "settle_ms": 1.0},
    )
    typical = {"coefficient_mn_s_per_mm": 0.3, "settle_ms": 0.05}
    words = "the tissue resists how fast it is pressed, besides how deep"
    source = "Kelvin element in parallel"
    separated_by = "rigid_target"

    def tissue_force_mn(
        self, trial: CellTrial, depth_mm: FloatArray, tissue: Tissue, p: Values
    ) -> FloatArray:
        """c dd/dt, averaged over each cell: it moves by 2w, and of a share s of it in contact d = s^2 w."""
        inside = np.minimum(np.sqrt(depth_mm / trial.half_travel_mm), 1.0)
        settled = low_pass(trial.velocity_mm_s * inside, trial.steps, 1e-3 * p.get("settle_ms", 0.0))
        return p["coefficient_mn_s_per_mm"] * settled
