"""What comes once in a trial at a time of its own: the skin shifts, or moves and returns, or the punch slips."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.model.effects import Acts, TrialState
from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]

SLIPS_S, SHIFTS_S = (0.006, 0.002), (0.015, 0.03, 0.06, 0.12, 0.24)
"""How long a step may take: a slip is over within milliseconds, skin that shifts is soft and takes ten or more.

By nothing else is a drop for which the surface gives way told from a shift away from the arm.
"""
STRETCH, BENT = 2.25, 5
"""No step is a straight ramp: within so many of its rises it is a smooth one, and has so many shapes of its own."""


@dataclass(frozen=True)
class Event:
    """A kind of step: whether it has one sign only, its unit, and its forms: how it acts and how long it takes (s).

    One that ``returns`` rises, stays and falls for so long each: no law of the library does so.
    """

    name: str
    one_sided: bool
    unit: float
    forms: tuple[tuple[Acts, float], ...]
    phases: tuple[str, ...]
    returns: bool = False


EVENTS = (
    Event("slip", True, 1.0, tuple((a, r) for a in ("share", "surface") for r in SLIPS_S), ("hold",)),
    Event("motion_artefact", False, 1e-3, tuple(("surface", r) for r in SHIFTS_S), ("dwell", "hold")),
    Event("transient", False, 1e-3, tuple(("surface", r) for r in SHIFTS_S), ("dwell", "hold"), returns=True),
)
SETTLES_S = (0.03, 0.5, 3.0)
CREEP = "creep"
SETTLES = 0.1
"""No step stays exactly as it was: it may creep by a tenth of its size with these times."""


def step_shape(trial: CellTrial, time_s: float, rise_s: float) -> FloatArray:
    """Return a step (n,) from 0 to 1 about a time, as the mean over each cell of a ramp of ``rise_s``."""
    half = 0.5 * trial.widths_s

    def integral(t: FloatArray) -> FloatArray:
        u = np.clip(t / rise_s + 0.5, 0.0, 1.0)
        return 0.5 * rise_s * u**2 + np.maximum(t - 0.5 * rise_s, 0.0)

    since = trial.time_s - time_s
    return np.asarray((integral(since + half) - integral(since - half)) / (2.0 * half))


def event_shape(event: Event, trial: CellTrial, time_s: float, rise_s: float) -> FloatArray:
    """Return what an event of size 1 does (n,): a step, or a rise and a fall."""
    if not event.returns:
        return step_shape(trial, time_s, rise_s)
    return step_shape(trial, time_s - rise_s, rise_s) - step_shape(trial, time_s + rise_s, rise_s)


def bent_shapes(event: Event, trial: CellTrial, time_s: float, rise_s: float) -> FloatArray:
    """Return how an event may go otherwise (BENT, n), as means over cells; each is nothing before and after.

    Speeds within -1 < u < 1 are those of a smooth step, (1 - u^2)^2, less the ramp's own, and that times u^k less what
    would be a step. What returns is at such places instead.
    """
    half_s = (1.0 if event.returns else 0.5) * STRETCH * rise_s
    u = np.linspace(-1.0, 1.0, 801)
    smooth = (1.0 - u**2) ** 2
    if event.returns:
        places = np.array([smooth * u**k for k in range(BENT)])
    else:
        ramp = (np.abs(u) < 1.0 / STRETCH).astype(float)
        speeds = [smooth / smooth.sum() - ramp / ramp.sum()]
        for k in range(1, BENT):
            bent = smooth * u**k
            speeds.append((bent - smooth * bent.sum() / smooth.sum()) / np.abs(bent).sum())
        places = np.cumsum(speeds, axis=1)
    area = np.cumsum(places, axis=1) * (u[1] - u[0])
    half = 0.5 * trial.widths_s
    before, after = ((trial.time_s - time_s + sign * half) / half_s for sign in (-1.0, 1.0))
    return np.array([np.interp(after, u, a) - np.interp(before, u, a) for a in area]) * half_s / (2.0 * half)


def one_unit(event: Event, acts: Acts, trial: CellTrial, state: TrialState, force_mn: FloatArray) -> float:
    """Return what a unit of an event is in that of its shape.

    A drop (mN) is lost for good as a share of the hold's force, or given up by the surface, and then the tissue
    relaxes towards what it was, as after any other step.
    """
    if acts == "share":
        held = force_mn[trial.in_phase("hold")]
        return 1.0 / max(float(np.median(held)), 1e-9)
    if event.one_sided:
        s = state.tissue
        return -1.0 / float(s.k0 + s.k1 + s.k2)
    return 1.0
