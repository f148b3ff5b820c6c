"""The Maxwell–Weichert solid's answer to any motion that is linear between its samples.

The solid is a spring ``k0`` beside arms of a spring ``k_i`` and a dashpot ``k_i tau_i`` in series:

    F(t) = k0 d(t) + sum_i k_i q_i(t),      dq_i/dt = dd/dt - q_i / tau_i

where d is the indentation depth and q_i the stretch of arm i's spring. For depth that is linear over an
interval h the stretch has the closed form

    q(t + h) = a q(t) + b (d(t + h) - d(t)),     a = exp(-h / tau),  b = (1 - a) tau / h

so the recursion below is exact, whatever the interval, and costs one pass over the samples.

Sampling is given by ``time``: one number is the interval between evenly spaced samples (s), an array
the instants of the samples (N,), rising strictly. Depth may carry leading dimensions (..., N); rows are
answered independently. The solid is at rest, its arms unloaded, at the first sample unless ``start_mm``
says otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.recordings.trial import FloatArray


def arm_response(
    depth_mm: FloatArray, time: float | FloatArray, tau_s: float, *, start_mm: float = 0.0
) -> FloatArray:
    """Return the stretch q of one arm's spring, (..., N) mm: the force of an arm of unit stiffness.

    ``depth_mm`` is (..., N); ``start_mm`` is the stretch at the first sample. Raises ValueError for a time
    constant that is not positive and finite, or for sampling that does not fit the depth.
    """
    depth_mm, step_s = _checked(depth_mm, time, tau_s)
    _, rise, _, _ = interval_factors(step_s, tau_s)
    return decaying_sum(rise * np.diff(depth_mm), step_s, tau_s, start_mm)


def arm_response_and_slope(
    depth_mm: FloatArray, time: float | FloatArray, tau_s: float, *, start_mm: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return the stretch q of one arm's spring (..., N) mm and its derivative by tau (..., N) mm/s.

    The derivative follows the differentiated recursion, so it is exact too.
    """
    depth_mm, step_s = _checked(depth_mm, time, tau_s)
    _, rise, decay_slope, rise_slope = interval_factors(step_s, tau_s)
    increments_mm = np.diff(depth_mm)
    stretch_mm = decaying_sum(rise * increments_mm, step_s, tau_s, start_mm)
    driven = decay_slope * stretch_mm[..., :-1] + rise_slope * increments_mm
    return stretch_mm, decaying_sum(driven, step_s, tau_s, 0.0)


def basis(depth_mm: FloatArray, time: float | FloatArray, times_s: Sequence[float]) -> FloatArray:
    """Return the forces of unit stiffnesses, (1 + n_arms, ..., N) mm: depth first, then one row an arm."""
    return np.stack(
        [np.asarray(depth_mm, dtype=float), *(arm_response(depth_mm, time, tau) for tau in times_s)]
    )


def force_response(
    depth_mm: FloatArray,
    time: float | FloatArray,
    k0_mn_per_mm: float,
    arms: Sequence[tuple[float, float]] = (),
    *,
    clip: bool = True,
) -> FloatArray:
    """Return the solid's force (..., N) mN for arms given as (stiffness in mN/mm, time constant in s).

    ``clip`` keeps it at or above zero: skin pushes the punch and never pulls it.
    """
    force_mn = k0_mn_per_mm * np.asarray(depth_mm, dtype=float)
    for stiffness_mn_per_mm, tau_s in arms:
        force_mn = force_mn + stiffness_mn_per_mm * arm_response(depth_mm, time, tau_s)
    return np.maximum(force_mn, 0.0) if clip else force_mn


def _checked(
    depth_mm: FloatArray, time: float | FloatArray, tau_s: float
) -> tuple[FloatArray, float | FloatArray]:
    depth_mm = np.asarray(depth_mm, dtype=float)
    if not (np.isfinite(tau_s) and tau_s > 0):
        raise ValueError(f"a relaxation time must be positive and finite, not {tau_s}")
    if np.ndim(time) == 0:
        interval_s = float(time)
        if not (np.isfinite(interval_s) and interval_s > 0):
            raise ValueError(f"the sampling interval must be positive and finite, not {interval_s}")
        return depth_mm, interval_s
    instants_s = np.asarray(time, dtype=float)
    if instants_s.shape != depth_mm.shape[-1:]:
        raise ValueError(f"{instants_s.shape[0]} instants do not fit {depth_mm.shape[-1]} depths")
    step_s = np.diff(instants_s)
    if not np.all(step_s > 0):
        raise ValueError("the instants of the samples must rise strictly")
    return depth_mm, step_s


def interval_factors(
    step_s: float | FloatArray, tau_s: float | FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return a, b of the recursion and their derivatives by tau, for one or all intervals."""
    ratio = np.asarray(step_s / tau_s, dtype=float)
    decay = np.exp(-ratio)
    # an interval that is nothing beside the time (ratio 0) has the limit 1
    rise = np.divide(-np.expm1(-ratio), ratio, out=np.ones_like(ratio), where=ratio > 0.0)
    return decay, rise, decay * ratio / tau_s, (rise - decay) / tau_s


def decaying_sum(driven: FloatArray, step_s: float | FloatArray, tau_s: float, start: float) -> FloatArray:
    """Return y (..., N) of y[n + 1] = exp(-step / tau) y[n] + driven[n], y[0] = start.

    The recursion is a triangular system with one band below the diagonal, which LAPACK solves in one pass.
    """
    from scipy.linalg.lapack import dtbtrs

    n_samples = driven.shape[-1] + 1
    rows = np.empty((*driven.shape[:-1], n_samples))
    rows[..., 0] = start
    rows[..., 1:] = driven
    band = np.zeros((2, n_samples))
    band[0] = 1.0
    band[1, :-1] = -np.exp(-step_s / tau_s)
    columns, fault = dtbtrs(band, rows.reshape(-1, n_samples).T, uplo="L", diag="U")
    if fault:
        raise ValueError(f"the recursion of an arm with a time of {tau_s} s can't be solved")
    return np.asarray(columns, dtype=float).T.reshape(rows.shape)
