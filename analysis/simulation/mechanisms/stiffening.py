"""The tissue gets stiffer the deeper it is pressed."""

from __future__ import annotations

import numpy as np
from numba import njit

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values


class Stiffening(Mechanism):
    """The tissue's law answers to d (1 + b d), or to d (d / D)^(p - 1), D being half of the study's largest depth.

    b is the first term of a hyperelastic law. The terms after it are ``growth`` g times those of collagen that
    straightens (Fung's exponential, (exp(2 b d) - 1) / (2 b)): d (1 + b d + g (2/3 (b d)^2 + 1/3 (b d)^3)), the
    textbook's law at g = 0; a layer of rubber (neo-Hooke) has twice of them and more. p goes from flat punch (1) over
    sphere (1.5) to cone (2) and knows no scale of length: D only keeps k0 a stiffness; a high one about a contact far
    back is an exponential, as of a fibre that is pulled. Where p is not 1 it rules, and b is only what it amounts to at
    D.
    """

    name = "stiffening"
    stage = "contact"
    parameters = (
        Parameter("coefficient_per_mm", "1/mm", 0.0, 1.0e4),
        Parameter("exponent", "1", 1.0, 64.0),
        Parameter("growth", "1", -0.5, 3.0, inner=True),
    )
    amplitude = "coefficient_per_mm"
    null = {"coefficient_per_mm": 0.0, "exponent": 1.0, "growth": 0.0}
    typical = {"coefficient_per_mm": 0.3, "exponent": 1.0, "growth": 0.0}
    words = "the skin gets stiffer the deeper it is pressed"
    source = "first terms of Fung's exponential (1967); Sneddon's punches, sphere and cone: force as a power of depth"
    separated_by = "three depths at three surface heights"

    def probe_settings(self, peak_force_mn: float, depth_mm: float) -> tuple[Values, ...]:
        """Either form of the law: a tenth of curvature over the study's own depths, or powers up to sphere and cone.

        A power far from 1 is not linear: what a tenth above 1 does says little of a cone.
        """
        curvature = {"coefficient_per_mm": 0.1 / max(depth_mm, 1e-12), "growth": 0.0}
        return (curvature, *({"exponent": p} for p in (1.1, 1.5, 2.0)))

    def holds(self, p: Values, depth_mm: float) -> bool:
        """A first term that is larger than what it is added to is none; such a law is a power."""
        return p["exponent"] != 1.0 or p.get("coefficient_per_mm", 0.0) * depth_mm <= 1.0

    def indentation_mm(self, trial: CellTrial, depth_mm: FloatArray, p: Values) -> FloatArray:
        """d (1 + b d + ...), or d (d / D)^(p - 1)."""
        if p["exponent"] == 1.0:
            # a power that was fitted may arrive at 1, where it has no curvature of the other form
            curved = _curved(depth_mm.ravel(), p.get("coefficient_per_mm", 0.0), p.get("growth", 0.0))
            return np.asarray(curved.reshape(depth_mm.shape))
        share = np.maximum(depth_mm, 0.0) / (0.5 * trial.study_depth_mm)
        # d^p = exp((p - 1) ln d) d, and 0 where nothing is pressed
        return np.where(share > 0.0, depth_mm * np.maximum(share, 1e-12) ** (p["exponent"] - 1.0), 0.0)


@njit(cache=True)
def _curved(depth_mm: FloatArray, per_mm: float, growth: float) -> FloatArray:
    found = np.empty_like(depth_mm)
    for i in range(len(depth_mm)):
        u = per_mm * depth_mm[i]
        found[i] = depth_mm[i] * (1.0 + u + growth * u * u * (2.0 + u) / 3.0)
    return found
