"""Where a mesh of the user's own is read: on its skin and under it, found by the faces of its tetrahedra."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.errors import BadInputError
from analysis.fingertip.meshing import PadMesh
from analysis.fingertip.pad_file import LAYERS
from analysis.fingertip.probes import SHALLOWEST_MM, Probes, along, depths
from analysis.recordings.trial import FloatArray

IntArray = NDArray[np.int64]

_STEEPEST = 0.5
"""Of the skin's normal, what has to point out of the pad (60 degrees) for a deflection along y to be read."""
_EDGE_MM = 0.1
"""Kept from the end of the mesh: it is a cut through the finger."""
_CORNERS = ((1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2))


def probes_on(mesh: PadMesh) -> Probes:
    """Return where to read the user's mesh; BadInputError where no layers lie under the load."""
    faces = _faces_of(mesh)
    pressed = pressed_corners(mesh)
    x_mm, _, z_mm = (pressed.min(axis=0) + pressed.max(axis=0)) / 2
    if mesh.copies == 2:
        x_mm = 0.0
    skin = faces.between(0, None)
    top_mm, _ = faces.cast(skin, x_mm, z_mm)
    ends = [faces.cast(faces.between(i, i + 1), x_mm, z_mm)[0] for i in range(2)]
    borders_mm = top_mm - np.array(ends)
    if not (0 < borders_mm[0] < borders_mm[1] and borders_mm[1] > SHALLOWEST_MM):
        raise BadInputError(
            f"{mesh.file}: {', '.join(LAYERS)} must lie one below the other under the middle of boundary "
            f"{mesh.pressed!r} (x = {x_mm:.3g}, z = {z_mm:.3g} mm), y out of the pad"
        )
    position_mm = along(*_reach(faces, skin, x_mm, z_mm))
    heights = [faces.cast(skin, x_mm, z_mm + p)[0] for p in position_mm.tolist()]
    skin_mm = np.stack([np.full(len(heights), x_mm), heights, z_mm + position_mm], axis=1)
    depth_mm = depths(borders_mm)
    inside_mm = np.stack(np.broadcast_arrays(x_mm, top_mm - depth_mm, z_mm), axis=1)
    return Probes(position_mm, skin_mm, depth_mm, inside_mm, borders_mm)


def pressed_corners(mesh: PadMesh) -> FloatArray:
    """Return the corners of the faces that are pressed, (F, 3, 3) mm, as (3 F, 3)."""
    points = mesh.mesh.ngmesh.Coordinates()
    faces = [[v.nr for v in e.vertices] for e in mesh.mesh.Boundaries(mesh.pressed).Elements()]
    corners: FloatArray = points[np.array(faces).ravel()]
    return corners


def _reach(faces: _Faces, skin: IntArray, x_mm: float, z_mm: float) -> tuple[float, float]:
    """Return how far towards root and tip skin faces out of the pad, in one piece from the load."""
    found = []
    ends = faces.points[:, 2].min() + _EDGE_MM, faces.points[:, 2].max() - _EDGE_MM
    for sign, end in zip((-1.0, 1.0), ends, strict=True):
        reach = 0.0
        for step in np.arange(0.05, max(sign * (end - z_mm), 0.0), 0.05).tolist():
            _, upright = faces.cast(skin, x_mm, z_mm + sign * step)
            if not upright >= _STEEPEST:
                break
            reach = step
        found.append(reach)
    return found[0], found[1]


@dataclass(frozen=True, slots=True)
class _Faces:
    """Triangles (F, 3) of all tetrahedra, points (V, 3) mm, and the layers either side, (F, 2); -1 is outside."""

    points: FloatArray
    triangles: IntArray
    sides: IntArray

    def between(self, layer: int, other: int | None) -> IntArray:
        """Return the triangles between a layer and another, or between any layer and the outside."""
        if other is None:
            return np.flatnonzero(self.sides[:, 0] == -1)
        return np.flatnonzero((self.sides[:, 0] == layer) & (self.sides[:, 1] == other))

    def cast(self, chosen: IntArray, x_mm: float, z_mm: float) -> tuple[float, float]:
        """Return the height of the highest of the triangles at x and z, and how upright it is; nan where none is."""
        corners = self.points[self.triangles[chosen]]
        first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        normal = np.cross(first, second)
        level = np.abs(normal[:, 1]) > 1e-9 * np.linalg.norm(normal, axis=1)
        corners, first, second, normal = (v[level] for v in (corners, first, second, normal))
        to_x, to_z = x_mm - corners[:, 0, 0], z_mm - corners[:, 0, 2]
        determinant = first[:, 0] * second[:, 2] - first[:, 2] * second[:, 0]
        a = (to_x * second[:, 2] - to_z * second[:, 0]) / determinant
        b = (first[:, 0] * to_z - first[:, 2] * to_x) / determinant
        hit = np.flatnonzero((a >= -1e-9) & (b >= -1e-9) & (a + b <= 1 + 1e-9))
        if not len(hit):
            return np.nan, np.nan
        heights = corners[hit, 0, 1] + a[hit] * first[hit, 1] + b[hit] * second[hit, 1]
        highest = hit[np.argmax(heights)]
        upright = np.abs(normal[highest, 1]) / np.linalg.norm(normal[highest])
        return float(heights.max()), float(upright)


def _faces_of(mesh: PadMesh) -> _Faces:
    from ngsolve import VOL

    elements = list(mesh.mesh.Elements(VOL))
    tetrahedra = np.array([[v.nr for v in e.vertices] for e in elements], dtype=np.int64)
    layer = np.array([LAYERS.index(e.mat) for e in elements], dtype=np.int64)
    every = np.sort(np.concatenate([tetrahedra[:, corners] for corners in _CORNERS]), axis=1)
    owner = np.tile(layer, len(_CORNERS))
    triangles, number = np.unique(every, axis=0, return_inverse=True)
    number = number.ravel()
    low, high = np.full(len(triangles), len(LAYERS)), np.full(len(triangles), -1)
    np.minimum.at(low, number, owner)
    np.maximum.at(high, number, owner)
    alone = np.bincount(number) == 1
    return _Faces(
        np.asarray(mesh.mesh.ngmesh.Coordinates(), dtype=float),
        triangles,
        np.stack([np.where(alone, -1, low), high], axis=1),
    )
