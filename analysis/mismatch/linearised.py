"""One trial about a simulation: its whitened residual, and its derivatives by what is shared and by its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.noise import Whitener
from analysis.mismatch.shared import Simulation
from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import PerTrial
from analysis.simulation.mechanism import Parameter

FloatArray = NDArray[np.float64]

Z0_STEP_MM = 5e-5


@dataclass(frozen=True)
class Linearised:
    """One trial around a simulation, whitened: residual r (n,), shared J (n, P), own A (n, q)."""

    r: FloatArray
    J: FloatArray
    A: FloatArray


def linearise(
    trial: CellTrial,
    whitener: Whitener,
    simulation: Simulation,
    own: PerTrial,
    trials: Sequence[CellTrial],
    coefficients: FloatArray | None,
    *,
    frozen: bool = False,
) -> Linearised:
    """Return residual and derivatives of one trial where what is latent in it has ``coefficients`` (q,).

    None leaves what is latent out; ``frozen`` leaves the shared parameters out (P = 0).
    """
    surface: FloatArray | float = 0.0
    added: FloatArray | float = 0.0
    if coefficients is not None:
        surface, added = simulation.latent_part(trial, own, coefficients)
    force = simulation.force_mn(trial, own, surface)
    columns = np.empty((len(force), 0))
    if not frozen:
        columns = shared_columns(trial, simulation, own, trials, force, surface)
    own_columns = [np.ones_like(force)] if trial.frees_offset else []
    by_z0 = np.zeros_like(force)
    if trial.touches:
        deeper = simulation.force_mn(trial, replace(own, z0_mm=own.z0_mm + Z0_STEP_MM), surface)
        by_z0 = (deeper - force) / Z0_STEP_MM
        own_columns.append(by_z0)
    if coefficients is not None:
        own_columns.append(simulation.latent_columns(trial, own, by_z0 != 0.0))
    A = np.column_stack([*own_columns, np.empty((len(force), 0))])
    residual = trial.force_mn - force - added
    stacked = whitener(np.column_stack([residual, columns, A]))
    p = columns.shape[1]
    r, J, A = stacked[:, 0], stacked[:, 1 : 1 + p], stacked[:, 1 + p :]
    if trial.touches and own.z0_mm <= trial.begins_mm:
        at = int(trial.frees_offset)
        if float(project_out(A, r[:, None])[1][at, 0]) < 0.0:
            # a trial begins before contact: a contact point at its beginning has nowhere to go
            A[:, at] = 0.0
    return Linearised(r, J, A)


def weighed_residual(
    trial: CellTrial, whitener: Whitener, simulation: Simulation, own: PerTrial, coefficients: FloatArray
) -> FloatArray:
    """Return what a simulation leaves of one trial, whitened, (n,)."""
    return whitener(trial.force_mn - simulation.whole_force_mn(trial, own, coefficients))


def shared_columns(
    trial: CellTrial,
    simulation: Simulation,
    own: PerTrial,
    trials: Sequence[CellTrial],
    force_mn: FloatArray,
    surface_mm: FloatArray | float = 0.0,
) -> FloatArray:
    """Return the derivatives (n, P) of a trial's simulated force (n,) by the shared parameters of the fit, mN.

    ``force_mn`` is that force, where the surface has moved by ``surface_mm`` (n,).
    """
    vector = simulation.vector(trials)
    columns = np.empty((len(force_mn), len(vector)))
    for k, parameter in enumerate(simulation.parameters(trials)):
        step = _step(parameter, float(vector[k]))
        moved = vector.copy()
        moved[k] += step
        columns[:, k] = (
            simulation.moved_to(moved, trials).force_mn(trial, own, surface_mm) - force_mn
        ) / step
    return columns


def _step(parameter: Parameter, fitted: float) -> float:
    """Return a finite-difference step on the scale of the fit that stays within the bounds."""
    if parameter.scale == "log":
        step = 1e-4
    elif parameter.scale == "inverse_square":
        step = 1e-3
    else:
        step = 1e-4 * max(abs(fitted), 0.05 * min(1.0, parameter.upper))
    ends = sorted((parameter.to_fit(parameter.lower), parameter.to_fit(parameter.upper)))
    return step if fitted + step <= ends[1] else -step


def compressed(line: Linearised) -> Linearised:
    """Return a trial with the same inner products in as few rows as it has columns: the triangle of its QR."""
    q = line.A.shape[1]
    triangle: FloatArray = np.asarray(np.linalg.qr(np.column_stack([line.A, line.r, line.J]), mode="r"))
    return Linearised(triangle[:, q], triangle[:, q + 1 :], triangle[:, :q])


def project_out(A: FloatArray, M: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return M (n, m) without what the columns of A (n, q) explain, and the coefficients (q, m)."""
    scale = np.linalg.norm(A, axis=0)
    scale[scale == 0] = 1.0
    q, r = np.linalg.qr(A / scale)
    keep = np.abs(np.diag(r)) > 1e-9
    if not keep.all():
        beta, *_ = np.linalg.lstsq(A / scale, M, rcond=1e-9)
        return M - (A / scale) @ beta, beta / scale[:, None]
    inner = q.T @ M
    beta = np.linalg.solve(r, inner)
    return M - q @ inner, beta / scale[:, None]


def column_space(A: FloatArray) -> FloatArray:
    """Return an orthonormal basis (n, p), p <= q, of what the columns of A (n, q) span."""
    scale = np.linalg.norm(A, axis=0)
    u, size, _ = np.linalg.svd(A[:, scale > 0] / scale[scale > 0], full_matrices=False)
    return np.asarray(u[:, size > 1e-9])
