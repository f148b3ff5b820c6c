"""The pad where contact grows: patches of skin, what pressing each of them moves, in some hundred shapes.

Skin that may touch is cut into patches; a patch carries one pressure along y and is held back by its mean
displacement along y, so the pressed area and its compliance are B A^(-1) B^T exactly, whatever the elements'
order. (Multipliers at the nodes of quadratic elements are no pressures: at corners they have the wrong sign.)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.fingertip.cache import key_of, recall
from analysis.fingertip.elastic import ElasticPad, nus_of
from analysis.fingertip.meshing import FIXED, LINE_LENGTH_MM, Load, mesh_pad
from analysis.fingertip.pad_file import PadFile
from analysis.fingertip.probes import BALL_MM, probes_of
from analysis.fingertip.progress import shown_progress
from analysis.fingertip.reduced import energy_basis
from analysis.fingertip.view import MeshView, view_of
from analysis.recordings.trial import FloatArray

LINE_PATCHES = 30
"""Of half the line: 0.083 mm each."""
_ROUNDING = 1e-12
_INWARDS = (0.0, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2)
_STENCIL = BALL_MM * np.array(
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1], [0.6, 0.6, 0], [0.6, 0, 0.6]]
)


@dataclass(frozen=True, slots=True)
class ContactPad:
    """A pad with m patches of skin in n shapes, none of them driven.

    Attributes:
        layers: stiffness of each layer for 1 kPa, (L, n, n) mN/mm, of the whole pad.
        relative: moduli of the layers beside each other at a ratio of 1, (L,).
        press: integral over each patch of the displacement into the pad, (m, n) mm2 per mm.
        area_mm2: of the patches, (m,); both halves of the pad.
        gap_mm: how far each patch lies below the highest point, (m,).
        place_mm: middle of each patch, x and z, (m, 2).
        position_mm: places along the finger from the line of contact, towards the tip, (q,).
        deflection: displacement into the pad of the skin there, (q, n).
        depth_mm: depths under the middle of the load, (d,).
        borders_mm: depths there at which epidermis and dermis end, (2,).
        strain: of each shape at those depths, (d, 3, 3, n).
        unknowns: of the full mesh.
        view: the mesh to look at.
    """

    layers: FloatArray
    relative: FloatArray
    press: FloatArray
    area_mm2: FloatArray
    gap_mm: FloatArray
    place_mm: FloatArray
    position_mm: FloatArray
    deflection: FloatArray
    depth_mm: FloatArray
    borders_mm: FloatArray
    strain: FloatArray
    unknowns: int
    view: MeshView


_FIELDS = tuple(name for name in ContactPad.__dataclass_fields__ if name not in {"view", "unknowns"})


def contact_pad(pad: PadFile, load: Load, ratios: FloatArray, cache: Path) -> ContactPad:
    """Return the pad under a line or plate, its shapes taken at ratios of core to epidermis (R,).

    Solved now or found in the cache.
    """
    key = key_of(pad, load, {"ratios": [f"{r:.6g}" for r in ratios], "patches": LINE_PATCHES})

    def solve() -> Mapping[str, Any]:
        with shown_progress(f"solving the pad under the {load}", len(ratios)) as advance:
            found = reduce_contact(pad, load, ratios, advance)
        view = {f"view_{name}": array for name, array in found.view.arrays().items()}
        return {**{n: getattr(found, n) for n in _FIELDS}, "unknowns": np.array(found.unknowns), **view}

    stored = recall(cache, key, solve)
    view = MeshView(**{name: stored[f"view_{name}"] for name in MeshView.__dataclass_fields__})
    return ContactPad(**{n: stored[n] for n in _FIELDS}, unknowns=int(stored["unknowns"]), view=view)


def reduce_contact(
    pad: PadFile, load: Load, ratios: FloatArray, advance: Callable[[], None] = lambda: None
) -> ContactPad:
    """Mesh the pad, press every patch at every ratio, and return it in the shapes that result."""
    mesh = mesh_pad(pad, load)
    probes = probes_of(pad, mesh)
    full = ElasticPad(mesh, nus_of(pad), held=FIXED)
    patches = cut_patches(full, load)
    relative = np.array(pad.relative_moduli())
    answers = press_patches(full, patches, ratios, relative, advance)
    combine, layers, press = shapes_of(full, patches, answers)
    fields = _Fields(full, answers)
    deflection = -fields.at(probes.skin_mm)[0][:, 1, :] @ combine
    strain = np.stack([_strain(fields, middle) for middle in probes.inside_mm]) @ combine
    view = view_of(full.mesh, answers, combine, full.space)
    return ContactPad(
        layers, relative, press, patches.area_mm2, patches.gap_mm, patches.place_mm, probes.position_mm, deflection,
        probes.depth_mm, probes.borders_mm, strain, full.unknowns, view,
    )  # fmt: skip


def press_patches(
    full: ElasticPad,
    patches: Patches,
    ratios: FloatArray,
    relative: FloatArray,
    advance: Callable[[], None] = lambda: None,
) -> list[Any]:
    """Return the answers (R x m vectors) of a full mesh to 1 kPa on each patch, at ratios (R,)."""
    answers = []
    for ratio in ratios:
        inverse = full.inverse(full.mixture([relative[0], *(ratio * relative[1:])]))
        for form in patches.forms:
            answer = form.CreateVector()
            answer.data = inverse * form
            answers.append(answer)
        advance()
    return answers


def shapes_of(
    full: ElasticPad, patches: Patches, answers: list[Any]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return n combinations of M answers without what is rounding (M, n), layers (L, n, n) and press (m, n)."""
    gram = full.gram(answers, answers)
    gram = (gram + gram.transpose(0, 2, 1)) / 2
    combine = energy_basis(gram.sum(axis=0), _ROUNDING)
    layers = np.einsum("am,lab,bn->lmn", combine, gram, combine, optimize=True)
    values = np.stack([answer.FV().NumPy() for answer in answers])
    forms = np.stack([form.FV().NumPy() for form in patches.forms])
    press: FloatArray = full.mesh.copies * forms @ values.T @ combine
    return combine, layers, press


@dataclass(frozen=True, slots=True)
class Patches:
    """Patches of skin: their load vectors for 1 kPa, areas (m,), gaps (m,), and places x and z (m, 2)."""

    forms: list[Any]
    area_mm2: FloatArray
    gap_mm: FloatArray
    place_mm: FloatArray


def cut_patches(full: ElasticPad, load: Load) -> Patches:
    """Return the patches: under a line, pieces of its length; under a plate, the faces of the elements."""
    from ngsolve import BND, GridFunction, Integrate, LinearForm, SurfaceL2, ds, x, y, z

    mesh = full.mesh
    boundary = mesh.mesh.Boundaries(mesh.pressed)
    chosen = GridFunction(SurfaceL2(mesh.mesh, order=0))
    values = chosen.vec.FV().NumPy()

    def of_faces(function: Any) -> FloatArray:
        integral = Integrate(function, mesh.mesh, BND, definedon=boundary, element_wise=True)
        return np.array(integral.NumPy(), dtype=float)

    area = of_faces(1.0)
    on = np.flatnonzero(area)
    middle = np.stack([of_faces(c)[on] / area[on] for c in (x, y, z)], axis=1)
    watched = set(on.tolist())
    unknown = {e.nr: chosen.space.GetDofNrs(e)[0] for e in mesh.mesh.Elements(BND) if e.nr in watched}
    if load == "line":
        # a whole pad has them on either side of x = 0
        pieces = np.floor(middle[:, 0] / (LINE_LENGTH_MM / 2) * LINE_PATCHES).astype(int)
        members = np.clip(pieces, -LINE_PATCHES, LINE_PATCHES - 1)
    else:
        members = np.arange(len(on))
    forms, numbers = [], np.unique(members)
    test = full.space.TestFunction()
    for number in numbers:
        values[:] = 0.0
        values[[unknown[int(e)] for e in on[members == number]]] = 1.0
        form = LinearForm(full.space)
        form += -chosen * test[1] * ds(mesh.pressed)
        forms.append(form.Assemble().vec)
    share = [area[on][members == n] for n in numbers]
    mean = np.stack(
        [np.average(middle[members == n], axis=0, weights=a) for n, a in zip(numbers, share, strict=True)]
    )
    top = skin_top_mm(full)
    return Patches(
        forms, mesh.copies * np.array([a.sum() for a in share]), top - mean[:, 1], mean[:, [0, 2]]
    )  # fmt: skip


def skin_top_mm(full: ElasticPad) -> float:
    """Return the height of the highest point of the pressed skin, mm."""
    geometry = full.mesh.geometry
    if geometry is not None:
        return float(geometry.half_height_mm.value)
    mesh = full.mesh.mesh
    return float(
        max(mesh[v].point[1] for e in mesh.Boundaries(full.mesh.pressed).Elements() for v in e.vertices)
    )


class _Fields:
    """Displacements of solved fields, and of the map of the geometry, at points of the mesher's."""

    def __init__(self, full: ElasticPad, answers: list[Any]) -> None:
        from ngsolve import GridFunction

        self._full, self._answers = full, answers
        self._field = GridFunction(full.space)
        self.halved = full.mesh.copies == 2

    def at(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return displacements (P, 3, M) of the fields at points (P, 3), and where the map puts these (P, 3)."""
        points = np.array([self._inside(point) for point in points])
        places = self._full.mesh.mesh(*points.T)
        found = np.empty((*points.shape, len(self._answers)))
        for number, answer in enumerate(self._answers):
            self._field.vec.data = answer
            found[:, :, number] = self._field(places)
        keep = self._full.mesh.keep
        return found, points if keep is None else points + keep(places)

    def _inside(self, point: FloatArray) -> FloatArray:
        """Return the point, or the nearest below it where the mesh's bent faces cut the corner of the capsule."""
        # a capsule's points move towards its axis, those of a mesh that lies anywhere straight down
        own = self._full.mesh.geometry is None
        inwards = np.array([0.0, 1.0, 0.0]) if own else point * [1.0, 1.0, float(point[2] > 0)]
        for share in _INWARDS:
            moved = point - share * inwards
            if self._full.mesh.mesh.Contains(*moved.tolist()):
                return moved
        raise ValueError(f"the point {point} lies outside of the mesh")


def _strain(fields: _Fields, middle_mm: FloatArray) -> FloatArray:
    """Return the strain (3, 3, M) at a point: the plane that displacements in a small ball round it fit."""
    # beyond x = 0 the other half of a half pad is its mirror image, and a whole pad is asked there
    mirror = np.array([-1.0, 1.0, 1.0])
    if fields.halved:
        half, points = fields.at(middle_mm + _STENCIL)
        moved = np.concatenate([half, half * mirror[:, None]])
        places = np.concatenate([points, points * mirror])
    else:
        moved, places = fields.at(middle_mm + np.concatenate([_STENCIL, _STENCIL * mirror]))
    design = np.column_stack([np.ones(len(places)), places - places[0]])
    gradient = np.linalg.lstsq(design, moved.reshape(len(places), -1), rcond=None)[0][1:].reshape(3, 3, -1)
    strain: FloatArray = (gradient + gradient.transpose(1, 0, 2)) / 2
    return strain
