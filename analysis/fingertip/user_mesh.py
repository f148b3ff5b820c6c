"""A mesh of the user's own in place of the parametric pad: any format that meshio reads.

In mm, y out of the pad, tetrahedra. Regions epidermis, dermis, fat; boundaries bone, nail (if any), and what is
pressed: punch, strip or plate. A boundary symmetry in the plane x = 0 says that the mesh is half of a pad. Names are
physical groups (Gmsh) or sets of cells (Abaqus and others).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.errors import BadInputError
from analysis.fingertip.meshing import PRESSED, SYMMETRY, Load, PadMesh
from analysis.fingertip.pad_file import LAYERS

_ON_PLANE_MM = 1e-6


def read_mesh(path: Path, load: Load, order: int) -> PadMesh:
    """Read a mesh for a load; BadInputError where it can't be read or lacks a region or boundary."""
    mesh = _read(path)
    regions = _named(mesh, "tetra", 3)
    boundaries = _named(mesh, "triangle", 2)
    for name in LAYERS:
        if name not in regions:
            raise BadInputError(_lacks(path, "region of tetrahedra", name, regions))
    for name in ("bone", PRESSED[load]):
        if name not in boundaries:
            raise BadInputError(_lacks(path, "boundary of triangles", name, boundaries))
    points = np.asarray(mesh.points, dtype=float)
    if SYMMETRY in boundaries:
        off = float(np.abs(points[boundaries[SYMMETRY].ravel(), 0]).max())
        if off > _ON_PLANE_MM:
            raise BadInputError(
                f"{path}: boundary 'symmetry' lies up to {off:.3g} mm off the plane x = 0: move the mesh"
            )
    size_mm = float(np.ptp(points, axis=0).max())
    if not 1 <= size_mm <= 100:
        raise BadInputError(f"{path}: the pad is {size_mm:.3g} mm long: give the points in mm")
    built = _build(points, regions, boundaries)
    return PadMesh(built, load, PRESSED[load], 2 if SYMMETRY in boundaries else 1, None, order)


def _read(path: Path) -> Any:
    import meshio

    if not path.is_file():
        raise BadInputError(f"{path}: there is no such mesh file")
    try:
        return meshio.read(path)
    except (meshio.ReadError, OSError, ValueError, KeyError, IndexError, SystemExit) as error:
        reason = " ".join(str(error).split()) or "unknown format"
        raise BadInputError(f"{path}: can't be read as a mesh ({reason}): see meshio's formats") from error


def _lacks(path: Path, what: str, name: str, there: dict[str, Any]) -> str:
    return f"{path}: has no {what} named {name!r}: there are {', '.join(sorted(there)) or 'none'}"


def _named(mesh: Any, kind: str, dimension: int) -> dict[str, NDArray[np.int64]]:
    """Return the corners (n, 3 or 4) of the cells of a kind, quadratic ones included, by name."""
    corners = dimension + 1
    kinds = (kind, f"{kind}{'10' if dimension == 3 else '6'}")
    found: dict[str, list[NDArray[np.int64]]] = {}
    tags = {int(tag): name for name, (tag, of) in mesh.field_data.items() if int(of) == dimension}
    for number, block in enumerate(mesh.cells):
        if block.type not in kinds:
            continue
        if "gmsh:physical" in mesh.cell_data and tags:
            physical = np.asarray(mesh.cell_data["gmsh:physical"][number])
            for tag in np.unique(physical):
                if int(tag) in tags:
                    found.setdefault(tags[int(tag)], []).append(block.data[physical == tag, :corners])
            continue
        for name, members in mesh.cell_sets.items():
            if members[number] is not None and len(members[number]):
                chosen = np.asarray(members[number], dtype=np.int64)
                found.setdefault(name, []).append(block.data[chosen, :corners])
    return {name: np.concatenate(parts).astype(np.int64) for name, parts in found.items()}


def _build(
    points: NDArray[np.float64],
    regions: dict[str, NDArray[np.int64]],
    boundaries: dict[str, NDArray[np.int64]],
) -> Any:
    from netgen.meshing import Element2D, Element3D, FaceDescriptor, MeshPoint, Pnt
    from netgen.meshing import Mesh as NetgenMesh
    from ngsolve import Mesh

    netgen = NetgenMesh(dim=3)
    used = np.unique(np.concatenate([regions[name].ravel() for name in LAYERS]))
    ids = {int(i): netgen.Add(MeshPoint(Pnt(*points[i].tolist()))) for i in used}
    for number, name in enumerate(LAYERS, start=1):
        netgen.SetMaterial(number, name)
        for cell in regions[name]:
            netgen.Add(Element3D(number, [ids[int(i)] for i in _positive(points, cell)]))
    for number, (name, faces) in enumerate(boundaries.items(), start=1):
        netgen.Add(FaceDescriptor(surfnr=number, domin=1, domout=0, bc=number))
        netgen.SetBCName(number - 1, name)
        for face in faces:
            netgen.Add(Element2D(number, [ids[int(i)] for i in face]))
    return Mesh(netgen)


def _positive(points: NDArray[np.float64], cell: NDArray[np.int64]) -> list[int]:
    """Return a tetrahedron's corners in the order that Netgen counts as positive."""
    a, b, c, d = points[cell]
    corners: list[int] = cell.tolist()
    if np.dot(np.cross(b - a, c - a), d - a) > 0:
        corners[1], corners[2] = corners[2], corners[1]
    return corners
