"""The full mesh: NGSolve assembles every layer once, factors any mixture of them, and reads results off."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from analysis.fingertip.meshing import FIXED, SYMMETRY, PadMesh
from analysis.fingertip.pad_file import LAYERS, PadFile
from analysis.recordings.trial import FloatArray


class ElasticPad:
    """Layers' stiffness on a mesh, (n, n) each for a modulus of 1 kPa, and solutions for mixtures of them.

    Displacements are in mm, forces in mN, of the meshed part of the pad. ``held`` names boundaries that
    are fixed but for ``free_to_slide``, which are held along y only.
    """

    def __init__(
        self, mesh: PadMesh, nus: Sequence[float], *, held: str = FIXED, held_along_y: str = ""
    ) -> None:
        from ngsolve import BilinearForm, VectorH1, dx

        self.mesh = mesh
        self.space = VectorH1(
            mesh.mesh,
            order=mesh.order,
            dirichletx=f"{held}|{SYMMETRY}" if mesh.copies == 2 else held,
            dirichlety=f"{held}|{held_along_y}" if held_along_y else held,
            dirichletz=held,
        )
        u, v = self.space.TnT()
        # bent elements: a constant stress times a test gradient has degree 3 (p - 1), the default is exact to 2 (p - 1)
        bent = max(mesh.order - 1, 0)
        self.matrices = []
        for name, nu in zip(LAYERS, nus, strict=True):
            form = BilinearForm(self.space, symmetric=True)
            form += _density(u, v, nu) * dx(name, bonus_intorder=bent)
            form += 0 * _density(u, v, nu) * dx  # one pattern of entries, so that matrices can be added
            self.matrices.append(form.Assemble().mat)

    @property
    def unknowns(self) -> int:
        """Displacements that the mesh has."""
        return int(self.space.ndof)

    def mixture(self, moduli: Sequence[float] | FloatArray) -> Any:
        """Return sum_l E_l K_l as NGSolve's matrix."""
        whole = self.matrices[0].CreateMatrix()
        self._mix(whole, moduli)
        return whole

    def _mix(self, whole: Any, moduli: Sequence[float] | FloatArray) -> None:
        whole.AsVector().data = float(moduli[0]) * self.matrices[0].AsVector()
        for modulus, matrix in zip(moduli[1:], self.matrices[1:], strict=True):
            whole.AsVector().data += float(modulus) * matrix.AsVector()

    def inverse(self, matrix: Any) -> Any:
        """Return the factored matrix on the displacements that are free."""
        return matrix.Inverse(self.space.FreeDofs(), inverse="sparsecholesky")

    def pushed(self, boundary: str) -> Any:
        """Return a field that is 1 mm into the pad on a boundary and nothing elsewhere on the skin."""
        from ngsolve import CF, GridFunction

        field = GridFunction(self.space)
        field.Set(CF((0, -1, 0)), definedon=self.mesh.mesh.Boundaries(boundary))
        return field

    def pressed(
        self,
        boundary: str,
        ratios: FloatArray,
        relative: FloatArray,
        advance: Callable[[], None] = lambda: None,
    ) -> tuple[list[Any], FloatArray]:
        """Return answers (R vectors) to 1 mm on ``boundary`` for core ratios (R,), and forces (R,) mN.

        Forces are those of the whole pad; ``advance`` is called once a ratio.
        """
        given = self.pushed(boundary).vec
        answers, forces = [], []
        residual = given.CreateVector()
        matrix = inverse = None
        for ratio in ratios:
            moduli = [relative[0], *(ratio * relative[1:])]
            if inverse is None:
                matrix = self.mixture(moduli)
                inverse = self.inverse(matrix)
            else:
                # the order of elimination is that of the first
                self._mix(matrix, moduli)
                inverse.Update()
            answer = given.CreateVector()
            residual.data = matrix * given
            answer.data = given - inverse * residual
            residual.data = matrix * answer
            forces.append(self.mesh.copies * float(answer.InnerProduct(residual)))
            answers.append(answer)
            advance()
        return answers, np.array(forces)

    def pull_share(self, boundary: str, answer: Any, moduli: Sequence[float] | FloatArray) -> float:
        """Return the part of the force with which a boundary is pulled rather than pressed; 0 where none is.

        By the forces at its vertices: each is the pressure around one, weighted by a hat that is nowhere negative.
        """
        residual = answer.CreateVector()
        residual.data = self.mixture(moduli) * answer
        mesh = self.mesh.mesh
        there = {v.nr for e in mesh.Boundaries(boundary).Elements() for v in e.vertices}
        along_y = self.space.Range(1).start
        # whatever the order of the elements, the unknowns of a component begin with the vertices
        pressed = -residual.FV().NumPy()[along_y + np.array(sorted(there))]
        return float(np.maximum(-pressed, 0.0).sum() / np.abs(pressed).sum())

    def gram(self, left: Sequence[Any], right: Sequence[Any]) -> FloatArray:
        """Return left^T K_l right for every layer, (L, A, B), of the whole pad."""
        a = np.stack([vector.FV().NumPy() for vector in left])
        found = np.empty((len(self.matrices), len(left), len(right)))
        image = right[0].CreateVector()
        for j, vector in enumerate(right):
            for layer, matrix in enumerate(self.matrices):
                image.data = matrix * vector
                found[layer, :, j] = a @ image.FV().NumPy()
        return self.mesh.copies * found


def _density(u: Any, v: Any, nu: float) -> Any:
    """Return sigma(u) : eps(v) for a modulus of 1."""
    from ngsolve import Grad, InnerProduct, Trace

    strain_u, strain_v = (Grad(w) + Grad(w).trans for w in (u, v))
    shear, bulk = 1 / (2 * (1 + nu)), nu / ((1 + nu) * (1 - 2 * nu))
    return bulk / 4 * Trace(strain_u) * Trace(strain_v) + shear / 2 * InnerProduct(strain_u, strain_v)


def nus_of(pad: PadFile) -> tuple[float, ...]:
    """Return Poisson's ratios in the order of `LAYERS`."""
    return pad.layers.epidermis.nu, pad.layers.dermis.nu, pad.layers.fat.nu
