"""Skin stiffens as it is pressed."""

from __future__ import annotations

from dataclasses import replace

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Parts


class Stiffening(Effect):
    """The elongation of spring and arms grows faster than depth: d (1 + b d), or d^p.

    Shows in every contact, with the square of the depth. Rough: collagen straightens, the growth is
    exponential (Fung), (exp(2 b d) - 1) / (2 b) to the fourth power of d. With an exponent other than 1 the
    punch is a sphere (1.5), a cone (2) or between: r (d / r)^p, with the linear tissue's force at d = r.
    """

    name = "stiffening"
    stage = "contact"
    in_library = True
    phases = IN_CONTACT
    parameters = (
        Parameter("coefficient_per_mm", "1/mm", 0.3, -0.3, 5.0, "b: relative growth per depth"),
        Parameter("exponent", "1", 1.0, 1.0, 3.0, "p: power of the depth, instead of b"),
        Parameter(
            "reference_mm", "mm", 0.4, 0.01, 5.0, "r: depth at which the power's force is the linear one"
        ),
    )

    def fit(self, parts: Parts, *, skin: bool) -> Parts:
        """Make the tissue stiffen."""
        if not skin:
            return parts
        if self["exponent"] != 1.0:
            return replace(parts, exponent=self["exponent"], reference_mm=self["reference_mm"])
        return replace(parts, stiffening_per_mm=self["coefficient_per_mm"], stiffening_growth=self.rough)
