"""A mesh of the user's own in place of the parametric pad: any format that meshio reads.

In mm, y out of the pad, z towards the tip, tetrahedra. Regions epidermis, dermis, fat; boundaries bone, nail (if any),
and what is pressed: punch to calibrate, strip (0.02 x 5 mm, along x) to compare, plate (all that it may touch) for the
receptor, in one file or in one for each load. A boundary symmetry in the plane x = 0 says that the mesh is half of a
pad. Names are physical groups (Gmsh) or sets of cells (Abaqus and others). Under the load the mesh is refined to what
pad.toml says.
"""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.errors import BadInputError
from analysis.fingertip.meshing import (
    LINE_LENGTH_MM,
    LINE_WIDTH_MM,
    PRESSED,
    SYMMETRY,
    Load,
    PadMesh,
)
from analysis.fingertip.pad_file import LAYERS, PadFile
from analysis.fingertip.refining import refine_under

_TOOL_OFF = 0.1
"""By what share a tool's size may be off: a circle of straight edges, a strip round a finger."""
_ON_PLANE_MM = 1e-6


def read_mesh(pad: PadFile, load: Load, path: Path) -> PadMesh:
    """Read the pad's mesh for a load; BadInputError where it can't be read or lacks a region or boundary."""
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
    copies = 2 if SYMMETRY in boundaries else 1
    if copies == 2:
        off = float(np.abs(points[boundaries[SYMMETRY].ravel(), 0]).max())
        if off > _ON_PLANE_MM:
            raise BadInputError(
                f"{path}: boundary 'symmetry' lies up to {off:.3g} mm off the plane x = 0: move the mesh"
            )
    size_mm = float(np.ptp(points, axis=0).max())
    if not 1 <= size_mm <= 100:
        raise BadInputError(f"{path}: the pad is {size_mm:.3g} mm long: give the points in mm")
    _check_tool(path, pad, load, points[boundaries[PRESSED[load]]], copies)
    # boundaries of other loads may share faces with this one's
    used = {
        name: boundaries[name] for name in ("bone", "nail", SYMMETRY, PRESSED[load]) if name in boundaries
    }
    _check_apart(path, used)
    built = _build(points, regions, used)
    refine_under(path, built, load, pad.mesh)
    return PadMesh(built, load, PRESSED[load], copies, None, pad.mesh.order, file=path)


def _check_apart(path: Path, boundaries: dict[str, NDArray[np.int64]]) -> None:
    owner: dict[tuple[int, ...], str] = {}
    for name, faces in boundaries.items():
        for face in np.sort(faces, axis=1).tolist():
            first = owner.setdefault(tuple(face), name)
            if first != name:
                raise BadInputError(
                    f"{path}: boundaries {first!r} and {name!r} share a triangle: it can be in one only"
                )


def _check_tool(path: Path, pad: PadFile, load: Load, faces: NDArray[np.float64], copies: int) -> None:
    """Raise BadInputError where the boundary that is pressed (F, 3, 3) mm is not of the tool's size."""
    extent = np.ptp(faces.reshape(-1, 3), axis=0)
    if load == "punch":
        across = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        whole = copies * float(np.linalg.norm(across, axis=1).sum()) / 2
        wanted = np.pi * pad.punch.diameter_mm**2 / 4
        if abs(whole / wanted - 1) > _TOOL_OFF:
            raise BadInputError(
                f"{path}: boundary 'punch' has {whole:.3g} mm2, a punch of {pad.punch.diameter_mm:g} mm has "
                f"{wanted:.3g}: mark the skin under the punch, or change punch.diameter_mm"
            )
    if load == "line":
        length, width = copies * extent[0], extent[2]
        if max(abs(length / LINE_LENGTH_MM - 1), abs(width / LINE_WIDTH_MM - 1)) > _TOOL_OFF:
            raise BadInputError(
                f"{path}: boundary 'strip' reaches over {length:.3g} mm along x and {width:.2g} along z, the "
                f"line load over {LINE_LENGTH_MM:g} and {LINE_WIDTH_MM:g}: mark that strip of skin"
            )


def _read(path: Path) -> Any:
    import meshio

    if not path.is_file():
        raise BadInputError(f"{path}: there is no such mesh file")
    try:
        # some of its readers print an empty line, where a command prints the path of its page
        with contextlib.redirect_stdout(io.StringIO()):
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
