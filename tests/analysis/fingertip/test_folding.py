"""Bent elements that are turned inside out between the points at which others look."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.fingertip.folding import folded, lattice, monomials


@given(st.integers(0, 6), st.integers(0, 10**6))
def test_a_polynomial_is_known_by_its_values_on_the_lattice(degree: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    points = lattice(degree)
    wanted = random.normal(size=monomials(points, degree).shape[1])
    found = np.linalg.solve(monomials(points, degree), monomials(points, degree) @ wanted)
    elsewhere = lattice(16)
    np.testing.assert_allclose(
        monomials(elsewhere, degree) @ found, monomials(elsewhere, degree) @ wanted, atol=1e-7
    )


@pytest.mark.parametrize(("bend", "inside_out"), [(0.0, False), (0.9, False), (1.1, True)])
def test_a_cube_whose_side_is_bent_through_itself(bend: float, inside_out: bool) -> None:
    """x + bend x (1 - x) has the derivative 1 + bend (1 - 2 x): below zero at x = 1 from a bend of 1 on."""
    pytest.importorskip("ngsolve")
    from netgen.csg import unit_cube
    from ngsolve import CF, GridFunction, Mesh, VectorH1, x

    mesh = Mesh(unit_cube.GenerateMesh(maxh=0.5))
    moved = GridFunction(VectorH1(mesh, order=2))
    moved.Set(CF((bend * x * (1 - x), 0, 0)))
    mesh.SetDeformation(moved)
    assert folded(mesh, 2) is inside_out
