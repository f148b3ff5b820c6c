"""How force answers when the skin itself moves: the tissue's answer to a small movement of its surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import PerTrial, indentation
from analysis.simulation.mechanism import Tissue
from analysis.simulation.response import arms_force

FloatArray = NDArray[np.float64]
TOUCHING_MM = 5e-3


def pressed(trial: CellTrial, own: PerTrial) -> NDArray[np.bool_]:
    """Return the mask (n,) of cells in which the punch presses the skin."""
    return np.asarray(indentation(trial.position_mm, own.z0_mm, trial) > TOUCHING_MM)


def in_contact(trial: CellTrial, own: PerTrial) -> NDArray[np.bool_]:
    """Return the mask (n,) of cells in which the punch presses the skin, the retract left out."""
    return np.asarray(pressed(trial, own) & ~trial.retracting)


def surface_force(
    trial: CellTrial, tissue: Tissue, own: PerTrial, rows_mm: FloatArray, inside: NDArray[np.bool_]
) -> FloatArray:
    """Return the force (m, n) that movements of the surface towards the arm (m, n), mm, make ``inside`` (n,)."""
    w = rows_mm * inside
    times, stiffnesses = np.array([tissue.tau1, tissue.tau2]), np.array([tissue.k1, tissue.k2])
    force = tissue.k0 * w + arms_force(w, trial.steps, times, stiffnesses)
    return np.asarray(force * inside)
