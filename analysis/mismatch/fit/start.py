"""Where a joint fit begins: relaxation times by search, stiffnesses by non-negative least squares."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from analysis.errors import BadInputError
from analysis.mismatch.model.population import PARTS_RESOLVED
from analysis.simulation.cells import RIGID_STIFFNESS_MN_PER_MM, CellTrial
from analysis.simulation.forward import indentation
from analysis.simulation.mechanism import Tissue
from analysis.simulation.response import arm_force

FloatArray = NDArray[np.float64]

TRIALS_USED = 6


def start_tissue(
    trials: Sequence[CellTrial], contacts_mm: Sequence[float], forces_mn: Sequence[FloatArray]
) -> Tissue:
    """Return a first tissue for trials on skin, touched at ``contacts_mm``, that answers with forces (n_j,).

    Raises BadInputError where nothing resists the punch.
    """
    used = [j for j, t in enumerate(trials) if t.kind not in ("air_sweep", "rigid_target")][:TRIALS_USED]
    if not used:
        return Tissue(120.0, 44.0, 2.3, 35.0, 0.15)
    skin = [trials[j] for j in used]
    longest = longest_s(skin)
    taus = np.geomspace(longest / PARTS_RESOLVED, longest, 9)
    depths = [
        t.punch_ratio * indentation(t.position_mm, contacts_mm[j], t) for j, t in zip(used, skin, strict=True)
    ]
    weights = [np.sqrt(t.counts) * (t.fitted & ~t.retracting) for t in skin]
    y = np.concatenate([forces_mn[j] * w for j, w in zip(used, weights, strict=True)])
    elastic = np.concatenate([d * w for d, w in zip(depths, weights, strict=True)])
    arms = [
        np.concatenate(
            [arm_force(d, t.steps, float(tau)) * w for t, d, w in zip(skin, depths, weights, strict=True)]
        )
        for tau in taus
    ]
    everything = np.column_stack([elastic, *arms])
    gram, projected = everything.T @ everything, everything.T @ y
    best, found = np.inf, None
    # contacts may have been sent where no trial comes
    for i, j in combinations(range(len(taus)), 2) if np.any(elastic) else ():
        pick = [0, 1 + i, 1 + j]
        G = gram[np.ix_(pick, pick)]
        L = np.linalg.cholesky(G + 1e-9 * np.trace(G) * np.eye(3))
        k, _ = nnls(L.T, np.linalg.solve(L, projected[pick]))
        cost = float(k @ G @ k - 2 * k @ projected[pick])
        if cost < best:
            best, found = cost, (k, taus[j], taus[i])
    if found is None or not np.any(found[0] > 0):
        raise BadInputError(
            "no trial shows a force that grows with depth: nothing to compare a simulation with"
        )
    k, long_s, short_s = found
    floor = 1e-3 * float(np.max(k))
    return Tissue(max(k[0], floor), max(k[2], floor), float(long_s), max(k[1], floor), float(short_s))


def longest_s(trials: Sequence[CellTrial]) -> float:
    """Return how long the longest of the trials lasts, s."""
    return max(float(t.time_s[-1] - t.time_s[0]) for t in trials)


def start_rigid(trials: Sequence[CellTrial]) -> float:
    """Return a first stiffness of the stiff block (mN/mm): the middle of the compliances that a block may have."""
    stated = [t.target_stiffness_mn_per_mm for t in trials if t.target_stiffness_mn_per_mm]
    return stated[0] if stated else 2.0 * RIGID_STIFFNESS_MN_PER_MM
