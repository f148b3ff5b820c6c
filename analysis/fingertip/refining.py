"""A mesh of the user's own made fine enough under the load, by NGSolve's bisection of its elements."""

from __future__ import annotations

import itertools
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from analysis.errors import BadInputError
from analysis.fingertip.meshing import PRESSED, PUNCH, Load, contact_sizes_mm
from analysis.fingertip.pad_file import MeshSettings

_LONGER = {"punch": 1.25, "line": 1.25, "plate": 2.0}
"""How much longer than asked for an edge may be: as the mesher's own longest ones are."""
_ROUNDS = 60
_MOST_ELEMENTS = 200_000
_ON_PLANE_MM = 1e-6


def refine_under(path: Path, mesh: Any, load: Load, sizes: MeshSettings) -> None:
    """Bisect the elements of a mesh of NGSolve until those under the load are as small as the mesher makes them.

    Raises BadInputError where that would take more elements than can be solved.
    """
    face_mm, rim_mm = contact_sizes_mm(sizes, load)
    for _ in range(_ROUNDS):
        points = mesh.ngmesh.Coordinates()
        coarse = _too_long(mesh, points, PRESSED[load], _LONGER[load] * face_mm, 2 * rim_mm)
        if not coarse:
            return
        if mesh.ne > _MOST_ELEMENTS:
            break
        for element in mesh.Elements():
            corners = sorted(v.nr for v in element.vertices)
            mesh.SetRefinementFlag(element, any(e in coarse for e in itertools.combinations(corners, 2)))
        mesh.Refine()
    raise BadInputError(
        f"{path}: is too coarse under the load: refine boundary {PRESSED[load]!r} to {face_mm:.2g} mm"
        + (f", its rim to {rim_mm:.2g} mm" if load == PUNCH else "")
        + ", or make mesh.contact_size_mm larger"
    )


def _too_long(mesh: Any, points: Any, pressed: str, face_mm: float, rim_mm: float) -> set[tuple[int, int]]:
    """Return the edges (pairs of corners) of a boundary that are longer than they may be."""
    faces = [[v.nr for v in e.vertices] for e in mesh.Boundaries(pressed).Elements()]
    count = Counter(pair for face in faces for pair in itertools.combinations(sorted(face), 2))
    found = set()
    for (a, b), owners in count.items():
        # the cut through a half pad is no rim
        rim = owners == 1 and float(np.abs(points[[a, b], 0]).max()) > _ON_PLANE_MM
        if np.linalg.norm(points[a] - points[b]) > (rim_mm if rim else face_mm):
            found.add((a, b))
    return found
