"""Meshes of the pad by Netgen: half a pad (it is symmetric), refined where it is pressed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from analysis.errors import BadInputError
from analysis.fingertip.folding import folded
from analysis.fingertip.geometry import FAR_MM, capsule_x_mm, displacement_of_map, surfaces
from analysis.fingertip.pad_file import LAYERS, Geometry, MeshSettings, PadFile

Load = Literal["punch", "line", "plate"]
PUNCH, STRIP, PLATE = "punch", "strip", "plate"
PRESSED: dict[Load, str] = {"punch": PUNCH, "line": STRIP, "plate": PLATE}
"""The boundary that each load presses."""
FIXED = "bone|nail"
SYMMETRY = "symmetry"
LINE_WIDTH_MM, LINE_LENGTH_MM = 0.02, 5.0  # Kumar et al. 2015
_STRIP_DEPTH_MM = 0.05
"""Depth of the sliver of epidermis that is cut out under the line, so that the mesh follows its edges."""
_TRIES, _FINER = 6, 0.8
"""How often, and by how much, elements are made smaller where bent ones fold."""
_ACROSS = 0.55
"""Of the pad's half-width: what a plate pressed half a millimetre deep can touch."""


@dataclass(frozen=True, slots=True)
class PadMesh:
    """A mesh of half a pad (or of a whole one) as NGSolve holds it.

    ``mesh`` carries the map of the geometry as its deformation. ``pressed`` names the boundary that is
    pressed; ``copies`` is 2 where the mesh is half of the pad; ``geometry`` is None for a mesh of the
    user's own.
    """

    mesh: Any
    load: Load
    pressed: str
    copies: int
    geometry: Geometry | None
    order: int
    keep: Any = None
    """What the mesh's deformation lives in."""
    file: Path | None = None
    """The user's own."""


def mesh_pad(pad: PadFile, load: Load) -> PadMesh:
    """Return the mesh for a load: of the parametric pad, or of the user's own file."""
    file = pad.mesh.file_for(load)
    if file is not None:
        from analysis.fingertip.user_mesh import read_mesh

        return read_mesh(pad, load, file)
    from netgen.libngpy._meshing import NgException
    from netgen.occ import OCCGeometry
    from ngsolve import Mesh

    shape = _shape(pad, load)
    size_mm, grading = pad.mesh.size_mm, pad.mesh.grading
    for _ in range(_TRIES):
        try:
            # its threads make the same mesh and wait for each other: two seconds of processor where one needs half
            made = OCCGeometry(shape).GenerateMesh(maxh=size_mm, grading=grading, parallel_meshing=False)
        except NgException:
            # large elements that grow fast cut through thin layers
            size_mm, grading = _FINER * size_mm, _FINER * grading
            continue
        mesh = Mesh(made)
        mesh.Curve(pad.mesh.order)
        keep = _deform(mesh, pad)
        if not folded(mesh, pad.mesh.order):
            return PadMesh(mesh, load, PRESSED[load], 2, pad.geometry, pad.mesh.order, keep)
        size_mm *= _FINER
    raise BadInputError(
        f"the mesh folds where layers are thin, even with elements of {size_mm / _FINER:.2g} mm: make mesh.size_mm "
        "and mesh.grading smaller, or the thinnest layer thicker"
    )


def _deform(mesh: Any, pad: PadFile) -> Any:
    """Set the map of the geometry as the mesh's deformation; the function that holds it."""
    from ngsolve import GridFunction, VectorH1, x, y, z

    moved = GridFunction(VectorH1(mesh, order=pad.mesh.order))
    by_layer = {name: displacement_of_map(pad.geometry, i + 1, x, y, z) for i, name in enumerate(LAYERS)}
    # by values at nodes, which leave the plane of symmetry where it is; a mean over elements would not
    moved.Set(mesh.MaterialCF(by_layer), dual=True)
    mesh.SetDeformation(moved)
    return moved


def _shape(pad: PadFile, load: Load) -> Any:
    """Return the capsules as solids named by layer, their faces by boundary."""
    from netgen.occ import Box, Glue, Pnt

    geometry = pad.geometry
    half = Box(Pnt(0, -FAR_MM, -FAR_MM), Pnt(FAR_MM, FAR_MM, FAR_MM))
    half.faces.name = SYMMETRY
    tube_mm = geometry.tube_length_mm.value
    radii = [s.capsule_mm for s in surfaces(geometry)]
    names = ("skin", "border", "border", "bone")
    skin, first, second, bone = (_capsule(r, tube_mm, n) * half for r, n in zip(radii, names, strict=True))
    wedge = _beyond(math.radians(geometry.nail_angle_deg.value))
    epidermis = skin - first
    pressed = _pressed_part(pad, load, skin, first)
    nail = epidermis * wedge
    _rename(nail, "skin", "nail")
    parts = [
        (epidermis - wedge - pressed, 0),
        (pressed, 0),
        (nail, 0),
        (first - second, 1),
        (second - bone, 2),
    ]
    for part, layer in parts:
        part.mat(LAYERS[layer])
    whole = Glue([part for part, _ in parts])
    _refine(whole, pad, load)
    return whole


def _capsule(radius_mm: float, tube_mm: float, name: str) -> Any:
    from netgen.occ import Cylinder, Pnt, Sphere, Z

    capsule = Cylinder(Pnt(0, 0, -tube_mm), Z, r=radius_mm, h=tube_mm) + Sphere(Pnt(0, 0, 0), radius_mm)
    capsule.faces.name = name
    for face in capsule.faces:
        if abs(face.center.z + tube_mm) < 1e-6:
            face.name = "end"
    return capsule


def _beyond(angle: float) -> Any:
    """Return all that lies beyond an angle from the pad's side."""
    from netgen.occ import Axes, WorkPlane, X, Z

    far = FAR_MM
    plane = WorkPlane(Axes((0, 0, -far), n=Z, h=X))
    corners = plane.MoveTo(0, 0).LineTo(0, -far).LineTo(far, -far).LineTo(
        far * math.sin(angle), far * math.cos(angle)
    )  # fmt: skip
    wedge = corners.Close().Face().Extrude(2 * far)
    wedge.faces.name = "inside"
    return wedge


def _pressed_part(pad: PadFile, load: Load, skin: Any, first: Any) -> Any:
    """Return the piece of epidermis under the load; its outer face is named after the load."""
    from netgen.occ import Box, Cylinder, Pnt, Y

    z_mm = pad.geometry.contact_z_mm.value
    if load == "punch":
        tool = Cylinder(Pnt(0, 0, z_mm), Y, r=pad.punch.diameter_mm / 2, h=FAR_MM)
        name = PUNCH
    elif load == "line":
        if pad.geometry.half_width_mm.value <= LINE_LENGTH_MM / 2:
            raise BadInputError(
                f"half_width_mm = {pad.geometry.half_width_mm.value:g}: the line of {LINE_LENGTH_MM:g} mm is as wide "
                "as the pad: a pad under it has to be wider"
            )
        half_width, half_length = LINE_WIDTH_MM / 2, capsule_x_mm(pad.geometry, LINE_LENGTH_MM / 2)
        tool = Box(Pnt(0, 0, z_mm - half_width), Pnt(half_length, FAR_MM, z_mm + half_width))
        first = skin.Move((0, -_STRIP_DEPTH_MM, 0))
        name = STRIP
    else:
        across, back, forth = _plate_reach_mm(pad)
        tool = Box(Pnt(0, 0, back), Pnt(across, FAR_MM, forth))
        name = PLATE
    tool.faces.name = "inside"
    piece = (skin * tool) - first
    _rename(piece, "skin", name)
    return piece


def _plate_reach_mm(pad: PadFile) -> tuple[float, float, float]:
    """Return where skin is looked at for contact with the plate, in the mesher's coordinates: x, and z from, to."""
    geometry = pad.geometry
    half, middle = pad.plate.length_mm.value / 2, geometry.contact_z_mm.value
    back = max(middle - half, -geometry.tube_length_mm.value + 0.2)
    forth = middle + half
    if forth > 0:
        # the tip of the capsule is as long as the finger is wide
        forth *= geometry.half_width_mm.value / geometry.tip_length_mm.value
    return _ACROSS * geometry.half_width_mm.value, back, min(forth, 0.8 * geometry.half_width_mm.value)


def _rename(shape: Any, old: str, new: str) -> None:
    for face in shape.faces:
        if face.name == old:
            face.name = new


def _refine(whole: Any, pad: PadFile, load: Load) -> None:
    """Set the sizes of elements where the load is; a property set before the parts are joined is lost."""
    face_mm, rim_mm = contact_sizes_mm(pad.mesh, load)
    for face in whole.faces:
        if face.name == PRESSED[load]:
            _set_size(face, face_mm)
            if load == "punch":
                _refine_rim(face, rim_mm)


def contact_sizes_mm(sizes: MeshSettings, load: Load) -> tuple[float, float]:
    """Return the size of elements under a load, and at its rim: at that of the punch the stress has no bound."""
    smallest_mm = sizes.contact_size_mm
    if load == "punch":
        return 4 * smallest_mm, smallest_mm
    face_mm = max(4 * smallest_mm, sizes.line_size_mm) if load == "line" else sizes.size_mm / 2
    return face_mm, face_mm


def _set_size(shape: Any, size_mm: float) -> None:
    shape.maxh = size_mm


def _refine_rim(face: Any, size_mm: float) -> None:
    for edge in face.edges:
        if abs(edge.center.x) > 1e-6:
            _set_size(edge, size_mm)
