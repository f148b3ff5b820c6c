"""The pad without short cuts: every step solved on the full mesh, arms kept in full, contact by least squares.

What the reduced pads are checked against, and what concealed surfaces are made by. It shares the geometry and
the elements with the project and nothing of the reduction, the marching or the contact.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import nnls

from analysis.fingertip.contact_pad import _Fields, cut_patches
from analysis.fingertip.elastic import ElasticPad, nus_of
from analysis.fingertip.geometry import inside_point
from analysis.fingertip.meshing import FIXED, PUNCH, mesh_pad
from analysis.fingertip.pad_file import PadFile
from analysis.fingertip.viscoelastic import Prony


class _March:
    """Displacement and arms on the full mesh, stepped evenly."""

    def __init__(self, full: ElasticPad, materials: Sequence[Prony], step_s: float) -> None:
        self.full, self.step_s = full, step_s
        self.arms = [(full.matrices[i], m, tau) for i, one in enumerate(materials) for m, tau in one.arms]
        self.gain = [(1 - np.exp(-step_s / tau)) * tau / step_s for _, _, tau in self.arms]
        moduli = [
            one.relaxed_kpa + sum(m * (1 - np.exp(-step_s / tau)) * tau / step_s for m, tau in one.arms)
            for one in materials
        ]
        self.matrix = full.mixture(moduli)
        self.inverse = full.inverse(self.matrix)
        self.moved = self.matrix.CreateColVector()
        self.moved[:] = 0.0
        self.stretch = [self.moved.CreateVector() for _ in self.arms]
        for h in self.stretch:
            h[:] = 0.0

    def remembered(self):
        """The load of what the arms remember."""
        load, part, one = (self.moved.CreateVector() for _ in range(3))
        load[:] = 0.0
        for (matrix, modulus, tau), gain, h in zip(self.arms, self.gain, self.stretch, strict=True):
            part.data = gain * self.moved - np.exp(-self.step_s / tau) * h
            one.data = matrix * part
            load.data += modulus * one
        return load

    def take(self, moved) -> None:
        """Take the step to a displacement."""
        for (_, _, tau), gain, h in zip(self.arms, self.gain, self.stretch, strict=True):
            h.data = np.exp(-self.step_s / tau) * h + gain * moved - gain * self.moved
        self.moved.data = moved


def march_punch(
    pad: PadFile, materials: Sequence[Prony], depth_mm: Sequence[float], step_s: float
) -> np.ndarray:
    """Return the force (N,) mN on the bonded punch at depths (N,) mm, one a step from nothing."""
    full = ElasticPad(mesh_pad(pad, "punch"), nus_of(pad), held=f"{FIXED}|{PUNCH}")
    march = _March(full, materials, step_s)
    unit = full.pushed(PUNCH).vec
    forces = []
    for depth in depth_mm:
        load = march.remembered()
        given, residual, moved = (unit.CreateVector() for _ in range(3))
        given.data = float(depth) * unit
        residual.data = load - march.matrix * given
        moved.data = given + march.inverse * residual
        residual.data = march.matrix * moved - load
        forces.append(full.mesh.copies * unit.InnerProduct(residual))
        march.take(moved)
    return np.array(forces)


def march_line(
    pad: PadFile,
    materials: Sequence[Prony],
    depth_mm: Sequence[float],
    step_s: float,
    position_mm: np.ndarray,
) -> np.ndarray:
    """Return the deflection (q,) mm at places (q,) mm once a line went through depths (N,) mm, one a step."""
    full = ElasticPad(mesh_pad(pad, "line"), nus_of(pad), held=FIXED)
    patches = cut_patches(full, "line")
    march = _March(full, materials, step_s)
    answers = []
    for form in patches.forms:
        answer = form.CreateVector()
        answer.data = march.inverse * form
        answers.append(answer)
    copies = full.mesh.copies
    compliance = copies * np.array([[form.InnerProduct(a) for a in answers] for form in patches.forms])
    factor = np.linalg.cholesky((compliance + compliance.T) / 2)
    area = patches.area_mm2
    for depth in depth_mm:
        moved = march.moved.CreateVector()
        moved.data = march.inverse * march.remembered()
        free = copies * np.array([form.InnerProduct(moved) for form in patches.forms])
        wanted = area * (depth - patches.gap_mm) - free
        pressure, _ = nnls(factor.T, np.linalg.solve(factor, wanted), maxiter=1000)
        for p, answer in zip(pressure.tolist(), answers, strict=True):
            moved.data += p * answer
        march.take(moved)
    geometry = pad.geometry
    points = np.array([inside_point(geometry, 0.0, geometry.contact_z_mm.value + p) for p in position_mm])
    return -_Fields(full, [march.moved]).at(points)[0][:, 1, 0]
