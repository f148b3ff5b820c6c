"""Skin stiffens as it is pressed."""

from __future__ import annotations

from dataclasses import replace

from sim_hardware.effects.base import IN_CONTACT, Effect, Parameter
from sim_hardware.parts import Parts


class Stiffening(Effect):
    """The elongation of spring and arms grows faster than depth: d (1 + b d).

    Shows in every contact, with the square of the depth. Rough: collagen straightens, the growth is
    exponential (Fung), (exp(2 b d) - 1) / (2 b) to the fourth power of d.
    """

    name = "stiffening"
    stage = "contact"
    in_library = True
    phases = IN_CONTACT
    parameters = (Parameter("coefficient_per_mm", "1/mm", 0.3, -0.3, 5.0, "b: relative growth per depth"),)

    def fit(self, parts: Parts, *, skin: bool) -> Parts:
        """Make the tissue stiffen."""
        if not skin:
            return parts
        return replace(parts, stiffening_per_mm=self["coefficient_per_mm"], stiffening_growth=self.rough)
