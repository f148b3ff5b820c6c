"""What a trial leaves unexplained when it is free to have a tissue and a slow course of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.joint import JointFit
from analysis.mismatch.linearised import column_space, linearise
from analysis.mismatch.noise import Whitener
from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]

SLOW_ORDER = 3


@dataclass(frozen=True)
class Freed:
    """A whitened residual ``r`` (n,) less all that a trial could explain if it were free, and ``basis`` (n, p) of that.

    Free to have a contact point, an offset, a tissue and a slow course of its own: a gain that is off or a drift is
    no oscillation, but has a spectrum with lobes at the same places in every trial.
    """

    r: FloatArray
    basis: FloatArray


def freed_residuals(
    trials: Sequence[CellTrial], whiteners: Sequence[Whitener], fit: JointFit
) -> list[Freed | None]:
    """Return what each trial by itself leaves unexplained; None for trials without skin."""
    found: list[Freed | None] = []
    for j, (trial, whitener) in enumerate(zip(trials, whiteners, strict=True)):
        if trial.kind in ("air_sweep", "rigid_target"):
            found.append(None)
            continue
        line = linearise(trial, whitener, fit.simulation, fit.own[j], trials, fit.latents[j])
        t = trial.time_s
        course = np.polynomial.legendre.legvander(2.0 * (t - t[0]) / (t[-1] - t[0]) - 1.0, SLOW_ORDER)[:, 1:]
        basis = column_space(np.column_stack([line.A, line.J, whitener(course)]))
        found.append(Freed(line.r - basis @ (basis.T @ line.r), basis))
    return found


def freed_evidence(trials: Sequence[CellTrial], whiteners: Sequence[Whitener], fit: JointFit) -> float:
    """Return twice the logarithm of the likelihood of freed residuals, for noise as the whiteners have it."""
    found = freed_residuals(trials, whiteners, fit)
    pairs = ((free, w) for free, w in zip(found, whiteners, strict=True) if free is not None)
    return sum(2.0 * float(np.sum(np.log(w.scale))) - float(free.r @ free.r) for free, w in pairs)
