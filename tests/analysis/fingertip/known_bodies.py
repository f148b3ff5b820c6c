"""Bodies whose answers are known: a bar of three slabs, a half-space. Meshes as the pad's, names and all."""

from __future__ import annotations

import math

import numpy as np

from analysis.fingertip.elastic import ElasticPad
from analysis.fingertip.meshing import PLATE, PUNCH, SYMMETRY, PadMesh
from analysis.fingertip.pad_file import LAYERS
from analysis.fingertip.punch import reduce_full
from analysis.fingertip.viscoelastic import Prony, relaxation


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
    mesh = Mesh(OCCGeometry(whole).GenerateMesh(maxh=0.5, parallel_meshing=False))
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
    made = OCCGeometry(whole).GenerateMesh(maxh=far_mm / 2, grading=0.4, parallel_meshing=False)
    mesh = Mesh(made)
    mesh.Curve(order)
    assert {pressed, "bone", SYMMETRY} <= set(mesh.GetBoundaries())
    return PadMesh(mesh, "plate" if pressed == PLATE else "punch", pressed, 2, None, order)


def patch_test(mesh: PadMesh) -> tuple[float, int]:
    """How far off a linear displacement is inside, held outside, as a share of its largest; and the free unknowns."""
    from ngsolve import CF, GridFunction, x, y, z

    full = ElasticPad(mesh, (0.48, 0.48, 0.48), held=".*")
    wanted, answer = GridFunction(full.space), GridFunction(full.space)
    slopes = np.array([[0.3, 0.1, 0.0], [-0.2, 0.5, 0.4], [0.1, -0.3, 0.2]])
    linear = CF(tuple(sum(float(a) * c for a, c in zip(row, (x, y, z), strict=True)) for row in slopes))
    wanted.Interpolate(linear)
    answer.vec.data = wanted.vec
    # nothing of the answer is left inside, so that it has to be solved for
    free = np.array([bool(b) for b in full.space.FreeDofs()])
    answer.vec.FV().NumPy()[free] = 0.0
    matrix = full.mixture([1.0, 1.0, 1.0])
    residual = answer.vec.CreateVector()
    residual.data = matrix * answer.vec
    answer.vec.data -= full.inverse(matrix) * residual
    right = wanted.vec.FV().NumPy()
    return float(np.abs(answer.vec.FV().NumPy() - right).max() / np.abs(right).max()), int(free.sum())


def prony_bar() -> tuple[float, float]:
    """How far off (relative) the reduced bar of three slabs is: one of two materials, and one of a single one.

    Without sideways strain three slabs are three springs in series: by hand compliances add up in Laplace's domain,
    and its inverse is taken by Talbot's contour. Compared from 10 ms to 20 s after a step.
    """
    full = ElasticPad(bar(), (0.0, 0.0, 0.0), held=f"{PUNCH}|bone")
    found = reduce_full(full, np.geomspace(0.03, 3, 6), np.array([1.0, 1.0, 1.0]))
    epidermis, core = Prony(30.0), Prony(3.0, ((4.0, 2.0), (2.0, 0.15)))
    time_s = np.geomspace(1e-2, 20, 30)

    def stiffness(s: complex) -> complex:
        soft = core.relaxed_kpa + sum(m * s / (s + 1 / tau) for m, tau in core.arms)
        return 1 / (1 / (3 * 30.0) + 2 / (3 * soft))

    by_hand = np.array([_talbot(lambda s: stiffness(s) / s, t) for t in time_s])
    layered = relaxation(found.layers, [epidermis, core, core]).after_step(time_s)
    single = relaxation(found.layers, [core] * 3).after_step(time_s)
    return float(np.abs(layered / by_hand - 1).max()), float(np.abs(single / core.at(time_s) - 1).max())


def _talbot(transform, time_s, count=32):
    """Abate and Whitt (2006): the fixed Talbot sum for the inverse of a Laplace transform."""
    angles = np.arange(1, count) * np.pi / count
    cot = 1 / np.tan(angles)
    delta = np.append(2 * count / 5, 2 * np.pi * np.arange(1, count) / 5 * (cot + 1j))
    gamma = np.append(
        np.exp(delta[0]) / 2,
        (1 + 1j * angles * (1 + cot**2) - 1j * cot) * np.exp(delta[1:]),
    )
    return 0.4 / time_s * sum((g * transform(d / time_s)).real for g, d in zip(gamma, delta, strict=True))
