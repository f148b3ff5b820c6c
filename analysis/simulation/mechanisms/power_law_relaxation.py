"""Relaxation without a time of its own: a power law."""

from __future__ import annotations

from math import gamma

import numpy as np

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Tissue, Tissues, Values
from analysis.simulation.response import arms_force

TAUS_S = np.geomspace(5e-5, 1e4, 18)
LOG_STEP = float(np.log(TAUS_S[1] / TAUS_S[0]))

_TEXTBOOK = {"begins_s": 1e-4}


class PowerLawRelaxation(Mechanism):
    """A spring-pot in parallel: kernel c (t / 1 s)^-a.

    t^-a = 1/Gamma(a) integral s^(a-1) exp(-s t) ds, summed on a logarithmic grid of times from 50 us to 10^4 s. No
    solid keeps to it at once: times shorter than ``begins_s`` carry less and less of it.
    """

    name = "power_law_relaxation"
    stage = "tissue"
    of_site = ("coefficient_mn_per_mm", "exponent")
    parameters = (
        Parameter("coefficient_mn_per_mm", "mN/mm", 0.0, 1.0e4),
        Parameter("exponent", "1", 0.02, 0.95),
        Parameter("begins_s", "s", 1e-5, 0.1, "log", inner=True),
    )
    amplitude = "coefficient_mn_per_mm"
    null = {"coefficient_mn_per_mm": 0.0, "exponent": 0.3, **_TEXTBOOK}
    probes = tuple(
        {"coefficient_mn_per_mm": 1.0, "exponent": a, **_TEXTBOOK} for a in (0.05, 0.15, 0.3, 0.5, 0.7)
    )
    typical = {"coefficient_mn_per_mm": 10.0, "exponent": 0.2, **_TEXTBOOK}
    words = "the tissue relaxes by a power law, over all times at once, instead of with two times only"
    source = "spring-pot (fractional element)"
    separated_by = "a longer hold"
    relaxes = True

    def tissue_force_mn(
        self, trial: CellTrial, depth_mm: FloatArray, tissue: Tissue | Tissues, p: Values
    ) -> FloatArray:
        """Force of the spring-pot."""
        a = p["exponent"]
        weights = p["coefficient_mn_per_mm"] * TAUS_S**-a * LOG_STEP / gamma(a)
        begun = 1.0 / (1.0 + p.get("begins_s", 0.0) / TAUS_S)
        return arms_force(depth_mm, trial.steps, TAUS_S, weights * begun)
