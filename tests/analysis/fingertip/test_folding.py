"""Bent elements that are turned inside out between the points at which others look."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.errors import BadInputError
from analysis.fingertip.folding import folded, lattice, monomials
from analysis.fingertip.meshing import mesh_pad


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


def test_a_mesher_that_gives_up_is_asked_for_smaller_elements(
    coarse_pad, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Large elements that grow fast cut through thin layers: the surface overlaps, and Netgen raises."""
    import netgen.occ
    from netgen.libngpy._meshing import NgException

    asked: list[tuple[float, float]] = []

    class Once:
        def __init__(self, shape: Any) -> None:
            self._geometry = made(shape)

        def GenerateMesh(self, *, maxh: float, grading: float, parallel_meshing: bool) -> Any:  # noqa: N802
            asked.append((maxh, grading))
            if len(asked) <= fails:
                raise NgException("Meshing failed!")
            return self._geometry.GenerateMesh(maxh=maxh, grading=grading, parallel_meshing=parallel_meshing)

    made, fails = netgen.occ.OCCGeometry, 1
    monkeypatch.setattr(netgen.occ, "OCCGeometry", Once)
    assert mesh_pad(coarse_pad, "punch").mesh.ne > 0
    assert asked[:2] == [(1.0, 0.7), (pytest.approx(0.8), pytest.approx(0.56))]
    fails = 99
    with pytest.raises(BadInputError, match=r"make mesh.size_mm and mesh.grading smaller"):
        mesh_pad(coarse_pad, "punch")
