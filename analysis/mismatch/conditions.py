"""Under which conditions simulation and recordings differ, in words: every depth, growing with it, one speed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.profiles import Profiles
from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]

LARGER = 1.5
CLEAR = 4.0


def conditions_in_words(
    trials: Sequence[CellTrial], profiles: Profiles, white_mn: float, bins: Sequence[int], with_depth: bool
) -> str:
    """Say under which conditions a window differs: every depth, growing with it, later trials, one kind."""
    counts = profiles.count[:, bins].sum(axis=1)
    use = counts > 0
    mean = (profiles.mean * profiles.count)[:, bins].sum(axis=1)[use] / counts[use]
    se = white_mn / np.sqrt(counts[use])
    chosen = [t for t, u in zip(trials, use, strict=True) if u]
    kinds = {t.kind for t in trials}
    only = f" ({chosen[0].kind.replace('_', ' ')} only)" if len({t.kind for t in chosen}) < len(kinds) else ""
    groups: dict[str, list[int]] = {}
    for j, t in enumerate(chosen):
        groups.setdefault(t.condition, []).append(j)
    if len(groups) < 2:
        return "every trial" + only + _order_words(chosen, mean)
    names, measures, unit = _what_varies(chosen, groups)
    means = np.array([np.average(mean[groups[g]], weights=se[groups[g]] ** -2) for g in names])
    errors = np.array([np.sum(se[groups[g]] ** -2) ** -0.5 for g in names])
    clear = np.abs(means) > CLEAR * errors
    what = "depth" if unit == "mm" else "speed" if unit == "mm/s" else "condition"
    order = _order_words(chosen, mean)
    if not unit:
        return ("every condition" if clear.all() else "some conditions only") + only + order
    shape = _shape(means, clear, measures, f" {unit}", with_depth)
    return shape.replace("@", what) + only + order


def _shape(
    means: FloatArray, clear: NDArray[np.bool_], measures: FloatArray, unit: str, with_depth: bool
) -> str:
    """Say how a mean residual goes with what varies ("@" stands for its name)."""
    first, last = means[0], means[-1]
    ends = f" ({first:+.2g} mN at {measures[0]:.2g}{unit}, {last:+.2g} mN at {measures[-1]:.2g}{unit})"
    if len({float(np.sign(m)) for m in means[clear]}) == 2:
        return f"changes sign with @{ends}"
    if with_depth and clear[-1] and abs(last) > LARGER * abs(first):
        return f"grows with @{ends}"
    if with_depth and clear[0] and abs(first) > LARGER * abs(last):
        return f"shrinks with @{ends}"
    if not clear.all() and clear.any():
        at = ", ".join(f"{m:.2g}" for m, c in zip(measures, clear, strict=True) if c)
        return f"clear at {at}{unit}"
    return "every @"


def _what_varies(
    trials: Sequence[CellTrial], groups: dict[str, list[int]]
) -> tuple[list[str], FloatArray, str]:
    """Return the conditions in order of what varies between them, its values and unit ("" if several do)."""
    depth = {g: float(np.median([trials[j].depth_mm for j in members])) for g, members in groups.items()}
    speed = {g: float(np.median([_speed(trials[j]) for j in members])) for g, members in groups.items()}
    sweep = all(t.kind == "air_sweep" for t in trials)
    if not sweep and max(depth.values()) > 1.2 * max(min(depth.values()), 1e-6):
        measure, unit = depth, "mm"
    elif max(speed.values()) > 1.2 * max(min(speed.values()), 1e-6):
        measure, unit = speed, "mm/s"
    else:
        return list(groups), np.arange(float(len(groups))), ""
    names = sorted(groups, key=lambda g: measure[g])
    return names, np.array([measure[g] for g in names]), unit


def _speed(trial: CellTrial) -> float:
    moving = trial.in_phase("ramp") | trial.in_phase("sweep")
    return float(np.median(np.abs(trial.velocity_mm_s[moving]))) if moving.any() else 0.0


def _order_words(trials: Sequence[CellTrial], mean: FloatArray) -> str:
    """Say that a residual follows the order of the trials, where it does beyond doubt."""
    if len(mean) < 8:
        return ""
    order = np.argsort(np.argsort([t.order for t in trials])).astype(float)
    depth = np.array([t.depth_mm for t in trials])
    columns = [np.ones_like(order), order - order.mean()]
    if np.ptp(depth) > 0.01:
        columns.append(depth - depth.mean())
    A = np.column_stack(columns)
    beta, *_ = np.linalg.lstsq(A, mean, rcond=None)
    left = mean - A @ beta
    spread = float(left @ left) / max(len(mean) - A.shape[1], 1)
    se = np.sqrt(spread * np.linalg.pinv(A.T @ A)[1, 1])
    if abs(beta[1]) > 6.0 * se and abs(beta[1]) * len(mean) > abs(float(np.mean(mean))):
        return f"; changes by {beta[1]:+.2g} mN from trial to trial"
    return ""
