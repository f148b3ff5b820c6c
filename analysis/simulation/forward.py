"""The forward model of a trial: recorded motion -> tip -> contact -> tissue -> sensor -> force."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from analysis.simulation.cells import RIGID_STIFFNESS_MN_PER_MM, CellTrial
from analysis.simulation.mechanism import Mechanism, Tissue, Tissues, Values
from analysis.simulation.response import arms_force

FloatArray = NDArray[np.float64]

COMPLIANCE_ROUNDS = 6


@dataclass(frozen=True, slots=True)
class PerTrial:
    """What belongs to one trial: contact point (mm), force offset (mN)."""

    z0_mm: float
    offset_mn: float


def indentation(position_mm: FloatArray, z0_mm: FloatArray | float, trial: CellTrial) -> FloatArray:
    """Return max(z - z0, 0) averaged over each cell, (..., n), mm.

    Within a cell the tip moves linearly by 2w: the mean of the kinked law is (m + w)^2 / (4 w) where the
    contact point lies inside; so the model stays smooth in z0 however coarse the cells are.
    """
    m = position_mm - z0_mm
    return np.asarray(_smooth_kink(m.reshape(-1, m.shape[-1]), trial.half_travel_mm).reshape(m.shape))


@njit(cache=True)
def _smooth_kink(rows: FloatArray, w: FloatArray) -> FloatArray:
    depth = np.empty_like(rows)
    for row in range(len(rows)):
        m = rows[row]
        for i in range(len(m)):
            if m[i] >= w[i]:
                depth[row, i] = m[i]
            elif m[i] <= -w[i]:
                depth[row, i] = 0.0
            else:
                depth[row, i] = (m[i] + w[i]) ** 2 / (4.0 * w[i])
    return depth


def _lifted(rows: FloatArray, time_s: FloatArray, widths_s: FloatArray) -> FloatArray:
    """Return max(force, 0) of rows (m, n), averaged over each cell, in which the force goes on in a line."""
    at = np.arange(len(time_s))
    before, after = np.maximum(at - 1, 0), np.minimum(at + 1, at[-1])
    half = 0.5 * np.abs(rows[:, after] - rows[:, before]) * widths_s / (time_s[after] - time_s[before])
    ends = np.minimum(rows[:, before], rows[:, after]) <= 0.0
    return np.vstack([_smooth_kink(row[None], w) for row, w in zip(rows, half * ends, strict=True)])


def simulate_force(
    trial: CellTrial,
    tissue: Tissue | Tissues,
    own: PerTrial,
    added: Sequence[tuple[Mechanism, Values]] = (),
    *,
    rigid_stiffness: float | None = None,
    surface_mm: FloatArray | float = 0.0,
    lost_share: FloatArray | float = 0.0,
    ideal_step: bool = False,
    averaged: bool = False,
) -> FloatArray:
    """Return the recorded force (n,) of a trial in mN.

    ``added`` are mechanisms with their parameters. ``surface_mm`` (a movement of the skin towards the arm)
    and ``lost_share`` (of the contact's force) carry what has its own time or phase in every trial; of m rows (m, n)
    of either, or of m tissues side by side, the force is (m, n).
    ``rigid_stiffness`` (mN/mm) is that of a block, where it is another than the trial states.
    ``ideal_step``: the textbook simplification, in which the indentation of the hold was reached at once at
    the end of the ramp. ``averaged``: where contact ends within a cell the force is the mean over it, not what the
    middle of the cell has.
    """
    added = [(m, p) for m, p in added if m.applies(trial)]
    if rigid_stiffness is None:
        rigid_stiffness = trial.target_stiffness_mn_per_mm or RIGID_STIFFNESS_MN_PER_MM
    if not trial.touches:
        contact = np.zeros(np.broadcast(trial.time_s, surface_mm, lost_share).shape)
    else:
        surface: FloatArray | float = surface_mm
        for m, p in added:
            surface = surface + m.surface_mm(trial, tissue, p)
        z0 = own.z0_mm - surface
        x = trial.position_mm
        hold_start = int(np.argmax(trial.in_phase("hold"))) if ideal_step else 0
        if ideal_step:
            x = np.where(np.arange(len(x)) < hold_start, own.z0_mm, x)
        rounds = COMPLIANCE_ROUNDS if any(m.needs_force for m, _ in added) else 1
        contact = np.zeros(np.broadcast(x, z0).shape)
        for _ in range(rounds):
            tip = x
            for m, p in added:
                tip = m.tip_mm(trial, tip, contact, p)
            new = _contact_force(trial, tip, z0, tissue, added, rigid_stiffness, ideal_step, averaged)
            contact = new if rounds == 1 else _relaxed(contact, new, trial, tissue, added, rigid_stiffness)
        contact = contact * (1.0 - lost_share)
    force = contact
    for m, p in sorted(added, key=lambda item: item[0].sensor_rank):
        force = m.sensor_force_mn(trial, force, p)
    reading = force + own.offset_mn
    for m, p in added:
        if m.bends_reading:
            reading = reading - m.unread_mn(force, own.offset_mn, p)
    return reading


def _relaxed(
    old: FloatArray,
    new: FloatArray,
    trial: CellTrial,
    tissue: Tissue | Tissues,
    added: Sequence[tuple[Mechanism, Values]],
    rigid_stiffness: float,
) -> FloatArray:
    """Take a fixed-point step damped so that it converges for any stiffness times compliance."""
    probe = np.ones_like(old)
    slope = 0.0
    for m, p in added:
        if m.needs_force:
            slope += float(np.mean(m.tip_mm(trial, np.zeros_like(old), probe, p)))
    stiffness = rigid_stiffness if trial.kind == "rigid_target" else trial.punch_ratio * tissue.stiffness
    return old + (new - old) / (1.0 - slope * stiffness)


def _contact_force(
    trial: CellTrial,
    tip: FloatArray,
    z0: FloatArray | float,
    tissue: Tissue | Tissues,
    added: Sequence[tuple[Mechanism, Values]],
    rigid_stiffness: float,
    ideal_step: bool,
    averaged: bool,
) -> FloatArray:
    depth = indentation(tip, z0, trial)
    if trial.kind == "rigid_target":
        return rigid_stiffness * depth
    for m, p in added:
        depth = m.indentation_mm(trial, depth, p)
    steps = trial.onset_steps if ideal_step else trial.steps
    free = tissue.k0 * depth + arms_force(depth, steps, *tissue.arms)
    for m, p in added:
        free = free + m.tissue_force_mn(trial, depth, tissue, p)
    free = trial.punch_ratio * free  # on one skin a flat punch's force grows with its diameter (Sneddon 1965)
    touching = np.maximum(free, 0.0)
    if averaged:
        touching = _lifted(free.reshape(-1, free.shape[-1]), trial.time_s, trial.widths_s).reshape(free.shape)
    for m, p in added:
        touching = m.contact_force_mn(trial, free, touching, p)
    return touching
