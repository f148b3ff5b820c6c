"""A mesh to look at: corners, tetrahedra, and what shapes do to the corners; sections and VTU files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.fingertip.meshing import SYMMETRY, PadMesh
from analysis.fingertip.pad_file import LAYERS
from analysis.recordings.trial import FloatArray

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class MeshView:
    """Corners (V, 3) mm, tetrahedra (T, 4) with their layer (T,), the section's triangles (S, 3) and layer (S,).

    ``shapes`` (n, V, 3) is what each shape of the reduced pad does to the corners.
    """

    corners_mm: FloatArray
    tetrahedra: IntArray
    layer: IntArray
    section: IntArray
    section_layer: IntArray
    shapes: FloatArray

    def arrays(self) -> dict[str, FloatArray | IntArray]:
        """Return what is to be stored, by field."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    def displaced(self, weights: FloatArray) -> FloatArray:
        """Return the displacement of the corners, (V, 3) mm, for weights (n,) of the shapes."""
        moved: FloatArray = np.tensordot(weights, self.shapes, 1)
        return moved


def view_of(mesh: PadMesh, fields: list[Any], combine: FloatArray, space: Any) -> MeshView:
    """Return the view of a mesh, its shapes ``fields`` (M vectors) combined by ``combine`` (M, n)."""
    from ngsolve import BND, VOL

    netgen = mesh.mesh.ngmesh
    # a copy: Netgen's own array is gone with its mesh
    corners = np.array(netgen.Coordinates())
    if mesh.keep is not None:
        corners = corners + _at_corners(mesh.keep.vec, mesh.keep.space, len(corners))
    moved = np.stack([_at_corners(field, space, len(corners)) for field in fields])
    tetrahedra = np.array([[v.nr for v in e.vertices] for e in mesh.mesh.Elements(VOL)], dtype=np.int64)
    layer = np.array([LAYERS.index(e.mat) for e in mesh.mesh.Elements(VOL)], dtype=np.int64)
    flat = [e for e in mesh.mesh.Elements(BND) if e.mat == SYMMETRY]
    section = np.array([[v.nr for v in e.vertices] for e in flat], dtype=np.int64).reshape(-1, 3)
    return MeshView(
        corners, tetrahedra, layer, section, _layers_of(section, tetrahedra, layer),
        np.tensordot(combine, moved, (0, 0)),
    )  # fmt: skip


def _at_corners(vector: Any, space: Any, count: int) -> FloatArray:
    """Return a field at the corners, (V, 3): NGSolve's first unknowns of a component are the corners' values."""
    values = vector.FV().NumPy()
    return np.stack([values[space.Range(i).start : space.Range(i).start + count] for i in range(3)], axis=1)


def _layers_of(triangles: IntArray, tetrahedra: IntArray, layer: IntArray) -> IntArray:
    """Return the layer of the tetrahedron behind each triangle."""
    owner = {
        tuple(sorted(np.delete(corners, skipped).tolist())): int(of)
        for corners, of in zip(tetrahedra, layer, strict=True)
        for skipped in range(4)
    }
    return np.array([owner[tuple(sorted(t.tolist()))] for t in triangles], dtype=np.int64)


def write_vtu(path: Path, view: MeshView, fields: Mapping[str, FloatArray]) -> None:
    """Write the mesh with its layers and fields at the corners ((V,) or (V, 3)) for ParaView."""
    import meshio

    meshio.Mesh(
        view.corners_mm,
        [("tetra", view.tetrahedra)],
        point_data=dict(fields),
        cell_data={"layer": [view.layer]},
    ).write(path, file_format="vtu")
