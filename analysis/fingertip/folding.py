"""Whether bent elements are turned inside out anywhere: their maps are polynomials, known whole by some points."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_LOOKED_AT = 16
"""Points along an edge, less one, at which an element's volume is looked at."""


def folded(mesh: Any, order: int) -> bool:
    """Return whether an element's map of an order, deformation included, has another sign of its determinant somewhere.

    That determinant is a polynomial of degree 3 (order - 1) on the element (Dey, O'Bara and Shephard, Computer-Aided
    Design 33:199, 2001), so that its values at as many points give it everywhere, corners and edges too.
    """
    from ngsolve import TET, VOL, Det, IntegrationRule, specialcf

    degree = 3 * (order - 1)
    known, looked_at = lattice(degree), lattice(max(_LOOKED_AT, degree))
    rule = IntegrationRule(points=[tuple(p) for p in known], weights=[1.0 / len(known)] * len(known))
    volume = np.asarray(Det(specialcf.JacobianMatrix(3))(mesh.MapToAllElements({TET: rule}, VOL)))
    by_element = volume.reshape(mesh.ne, len(known))
    everywhere = monomials(looked_at, degree) @ np.linalg.solve(monomials(known, degree), by_element.T)
    return bool(np.sign(everywhere.min()) != np.sign(everywhere.max()))


def lattice(degree: int) -> FloatArray:
    """Return the evenly spaced points (n, 3) of the unit tetrahedron that settle a polynomial of a degree."""
    n = max(degree, 1)
    grid = [(i, j, k) for i in range(n + 1) for j in range(n + 1 - i) for k in range(n + 1 - i - j)]
    return np.array(grid if degree else [(0.25, 0.25, 0.25)], dtype=np.float64) / (n if degree else 1)


def monomials(points: FloatArray, degree: int) -> FloatArray:
    """Return all monomials up to a degree (m, K) at points (m, 3)."""
    powers = [
        (i, j, k) for i in range(degree + 1) for j in range(degree + 1 - i) for k in range(degree + 1 - i - j)
    ]
    return np.column_stack([np.prod(points**p, axis=1) for p in powers])
