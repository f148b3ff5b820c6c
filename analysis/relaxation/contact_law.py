"""How force grows with depth: the contact law d^p of a punch, 1 flat, 1.5 a sphere, 2 a cone.

A punch whose contact grows as it sinks in meets more tissue; on a linear solid that never lets go of the
punch the relaxation then answers to d^p in place of d (Lee and Radok, J. Appl. Mech. 27, 438, 1960). Written
as d (d / D)^(p - 1) it stays in millimetres, and stiffnesses stay those of a flat punch at the depth D.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.recordings.trial import FloatArray

LOWEST, HIGHEST = (
    0.4,
    4.0,
)  # exponents that are searched; a blunted cone is 2, tissue that stiffens may be more


@dataclass(frozen=True, slots=True)
class ContactLaw:
    """Level d (d / reference_mm)^(exponent - 1) of a depth d; a reference of 1 mm gives d^p itself."""

    exponent: float = 1.0
    reference_mm: float = 1.0

    def level(self, depth_mm: FloatArray) -> FloatArray:
        """Return the level (N,) mm that a linear solid answers to, for depths (N,) mm, none below 0."""
        if self.exponent == 1.0:
            return depth_mm
        return np.asarray(
            self.reference_mm * np.power(depth_mm / self.reference_mm, self.exponent), dtype=float
        )

    def slope(self, depth_mm: FloatArray) -> FloatArray:
        """Return the derivative of the level by depth; at no depth that of the smallest one given."""
        if self.exponent == 1.0:
            return np.ones_like(depth_mm)
        share = np.maximum(depth_mm / self.reference_mm, 1e-9)
        return np.asarray(self.exponent * np.power(share, self.exponent - 1.0), dtype=float)

    def exponent_slope(self, depth_mm: FloatArray) -> FloatArray:
        """Return the derivative of the level by the exponent, mm."""
        share = np.maximum(depth_mm / self.reference_mm, 1e-300)
        return np.asarray(self.level(depth_mm) * np.log(share), dtype=float)


FLAT = ContactLaw()
