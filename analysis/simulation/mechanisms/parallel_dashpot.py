"""The tissue resists the speed of indentation."""

from __future__ import annotations

import numpy as np

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Tissue, Tissues, Values
from analysis.simulation.response import low_pass

_TEXTBOOK = {"settle_ms": 0.05, "with_depth": 0.0}


class ParallelDashpot(Mechanism):
    """F_t gains c dd/dt while in contact, within ``settle_ms`` where a spring is in series with it (0: none).

    More is wetted the deeper the punch goes, as (d/D)^``with_depth`` (0.5 under a sphere, whose contact's radius is
    that of its depth); c is the mean over the depths down to the study's largest, D.
    """

    name = "parallel_dashpot"
    stage = "tissue"
    of_site = ("coefficient_mn_s_per_mm",)
    parameters = (
        Parameter("coefficient_mn_s_per_mm", "mN s/mm", 0.0, 1.0e4),
        Parameter("settle_ms", "ms", 0.01, 5.0, "log", inner=True),
        Parameter("with_depth", "1", 0.0, 1.0, inner=True),
    )
    amplitude = "coefficient_mn_s_per_mm"
    null = {"coefficient_mn_s_per_mm": 0.0, **_TEXTBOOK}
    probes = (
        {"coefficient_mn_s_per_mm": 0.02, **_TEXTBOOK},
        {"coefficient_mn_s_per_mm": 0.02, **_TEXTBOOK, "settle_ms": 1.0},
    )
    typical = {"coefficient_mn_s_per_mm": 0.3, **_TEXTBOOK}
    words = "the tissue resists how fast it is pressed, besides how deep"
    source = "Kelvin element in parallel"
    separated_by = "rigid_target"
    like_a_quick_arm = True

    def tissue_force_mn(
        self, trial: CellTrial, depth_mm: FloatArray, tissue: Tissue | Tissues, p: Values
    ) -> FloatArray:
        """c dd/dt, averaged over each cell: it moves by 2w, and of a share s of it in contact d = s^2 w."""
        inside = np.minimum(np.sqrt(depth_mm / trial.half_travel_mm), 1.0)
        m = p.get("with_depth", 0.0)
        if m:
            inside = inside * (1.0 + m) * (depth_mm / trial.study_depth_mm) ** m
        settled = low_pass(trial.velocity_mm_s * inside, trial.steps, 1e-3 * p.get("settle_ms", 0.0))
        return p["coefficient_mn_s_per_mm"] * settled
