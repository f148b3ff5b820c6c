"""The pad in a few shapes: Galerkin's matrices of every layer on snapshots of the full mesh.

Linear elasticity with one Poisson's ratio a layer is K = sum_l E_l K_l. The answers to all ratios of moduli lie
close to a space of some ten shapes; in it a layer is a matrix of that size, and so is whatever is read off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.fingertip.view import MeshView
from analysis.recordings.trial import FloatArray


@dataclass(frozen=True, slots=True)
class PunchPad:
    """A pad under a punch that sticks, or slides without friction, in n shapes.

    The first shape moves the punch by 1 mm into the pad, the others leave it where it is.

    Attributes:
        layers: stiffness of each layer for a modulus of 1 kPa, (L, n, n) mN/mm, of the whole pad.
        ratios: of the core's modulus to the epidermis', that the shapes were taken at, (R,).
        exact: force of the full mesh at these ratios for 1 mm, epidermis 1 kPa, (R,) mN.
        relative: moduli of the layers beside each other at a ratio of 1, (L,).
        pull_share: part of the force with which a punch that slides would have to pull, the worst of the ratios;
            0 where no skin is pulled, as it must be without glue.
        unknowns: of the full mesh.
        view: the mesh to look at.
    """

    layers: FloatArray
    ratios: FloatArray
    exact: FloatArray
    relative: FloatArray
    pull_share: float
    unknowns: int
    view: MeshView

    def layer_moduli(self, ratio: float) -> FloatArray:
        """Return moduli (L,) of an epidermis of 1 and a core of ``ratio``."""
        return np.array([self.relative[0], *(ratio * self.relative[1:])])

    def answer(self, moduli_kpa: FloatArray) -> FloatArray:
        """Return the weights (n,) of the shapes when an elastic pad with moduli (L,) is pressed by 1 mm."""
        whole = np.tensordot(moduli_kpa, self.layers, 1)
        weights: FloatArray = np.concatenate([[1.0], -np.linalg.solve(whole[1:, 1:], whole[1:, 0])])
        return weights

    def stiffness(self, moduli_kpa: FloatArray) -> float:
        """Return the force for 1 mm of an elastic pad, mN/mm, with moduli (L,) kPa."""
        weights = self.answer(moduli_kpa)
        return float(np.tensordot(moduli_kpa, self.layers, 1)[0] @ weights)


def energy_basis(gram: FloatArray, keep: float) -> FloatArray:
    """Return combinations (M, n) of M shapes, orthonormal in ``gram`` (M, M), without what is rounding.

    Directions below ``keep`` times the largest eigenvalue are left out.
    """
    scale = 1 / np.sqrt(np.diag(gram))
    values, vectors = np.linalg.eigh(gram * scale[:, None] * scale)
    kept = values > keep * values[-1]
    basis: FloatArray = scale[:, None] * vectors[:, kept] / np.sqrt(values[kept])
    return basis


def chebyshev_ratios(low: float, high: float, count: int) -> FloatArray:
    """Return ``count`` Chebyshev points in log ratio between ``low`` and ``high``, rising."""
    points = np.cos(np.pi * (2 * np.arange(count) + 1) / (2 * count))[::-1]
    middle, half = (np.log(high) + np.log(low)) / 2, (np.log(high) - np.log(low)) / 2
    ratios: FloatArray = np.exp(middle + half * points)
    return ratios
