"""The tissue gets stiffer the deeper it is pressed."""

from __future__ import annotations

from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import FloatArray, Mechanism, Parameter, Values


class Stiffening(Mechanism):
    """The tissue's law answers to d (1 + b d + c d^2) instead of d; c, the ``curvature``, is 0 in the textbook."""

    name = "stiffening"
    stage = "contact"
    parameters = (
        Parameter("coefficient_per_mm", "1/mm", -0.3, 1.0e4),
        Parameter("curvature_per_mm2", "1/mm^2", -0.5, 1.0e8, inner=True),
    )
    amplitude = "coefficient_per_mm"
    null = {"coefficient_per_mm": 0.0, "curvature_per_mm2": 0.0}
    probes = (
        {"coefficient_per_mm": 0.02, "curvature_per_mm2": 0.0},
        {"coefficient_per_mm": 0.8, "curvature_per_mm2": 0.0},
    )
    typical = {"coefficient_per_mm": 0.3, "curvature_per_mm2": 0.0}
    words = "the skin gets stiffer the deeper it is pressed"
    source = "first term of a hyperelastic law"
    separated_by = "three depths at three surface heights"

    def indentation_mm(self, trial: CellTrial, depth_mm: FloatArray, p: Values) -> FloatArray:
        """d (1 + b d + c d^2)."""
        return depth_mm * (1.0 + (p["coefficient_per_mm"] + p["curvature_per_mm2"] * depth_mm) * depth_mm)
