"""Bodies whose answers are known: a bar of three slabs, a half-space. Meshes as the pad's, names and all."""

from __future__ import annotations

import math

from analysis.fingertip.meshing import PLATE, PUNCH, SYMMETRY, PadMesh
from analysis.fingertip.pad_file import LAYERS


def bar(order: int = 2) -> PadMesh:
    """A cube of 1 mm in three slabs of a third each along y, held below, pressed from above."""
    from netgen.occ import Box, Glue, OCCGeometry, Pnt
    from ngsolve import Mesh

    slabs = []
    for number, name in enumerate(LAYERS):
        slab = Box(Pnt(0, 1 - (number + 1) / 3, 0), Pnt(1, 1 - number / 3, 1))
        slab.mat(name)
        slabs.append(slab)
    whole = Glue(slabs)
    for face in whole.faces:
        face.name = {1.0: PUNCH, 0.0: "bone"}.get(round(face.center.y, 6), "side")
    mesh = Mesh(OCCGeometry(whole).GenerateMesh(maxh=0.5))
    return PadMesh(mesh, "punch", PUNCH, 1, None, order)


def half_space(
    radius_mm: float, size_mm: float, rim_mm: float, far_mm: float, order: int, pressed: str
) -> PadMesh:
    """Half of a half-ball of radius ``far_mm`` below y = 0, held far away; a disc on top is pressed or watched."""
    from netgen.occ import Box, Cylinder, Glue, OCCGeometry, Pnt, Sphere, Y
    from ngsolve import Mesh

    corner = 2 * far_mm
    half = Box(Pnt(0, -corner, -corner), Pnt(corner, 0, corner))
    half.faces.name = "skin"
    for face in half.faces:
        if abs(face.center.x) < 1e-9:
            face.name = SYMMETRY
    ball = Sphere(Pnt(0, 0, 0), far_mm)
    ball.faces.name = "bone"
    body = ball * half
    disc = body * Cylinder(Pnt(0, -radius_mm / 2, 0), Y, r=radius_mm, h=radius_mm)
    whole = Glue([body - disc, disc])
    whole.mat(LAYERS[0])
    for face in whole.faces:
        # the disc's face on top, of half the disc's area
        if abs(face.center.y) < 1e-9 and abs(face.mass / (math.pi * radius_mm**2 / 2) - 1) < 1e-3:
            face.name = pressed
            face.maxh = size_mm
            for edge in face.edges:
                if abs(edge.center.x) > 1e-9:
                    edge.maxh = rim_mm
    mesh = Mesh(OCCGeometry(whole).GenerateMesh(maxh=far_mm / 2, grading=0.4))
    mesh.Curve(order)
    assert {pressed, "bone", SYMMETRY} <= set(mesh.GetBoundaries())
    return PadMesh(mesh, "plate" if pressed == PLATE else "punch", pressed, 2, None, order)
