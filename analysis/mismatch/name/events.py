"""What comes in a trial at a time of its own: skin shifts, swells, moves and returns, the punch slips, gain jumps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.model.effects import Acts, OwnShape, TrialState
from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import library

FloatArray = NDArray[np.float64]

TIMES_LOOKED_AT = 70
"""About so many times of a trial are looked at for each event."""
SLIPS_S, SHIFTS_S, SWELLS_S = (0.006, 0.002), (0.015, 0.03, 0.06, 0.12, 0.24), (0.5, 1.0, 2.0, 4.0, 8.0)
"""How long a step may take: a slip is over within milliseconds, skin that shifts is soft and takes ten or more.

By nothing else is a drop for which the surface gives way told from a shift away from the arm. What takes longer still
swells or ebbs, as no skin that shifts does.
"""
STRETCH, BENT = 2.25, 5
"""No step is a straight ramp: within so many of its rises it is a smooth one, and has so many shapes of its own."""
ZEROS_S = (*SLIPS_S, 0.05, 0.5, 4.0)
"""A zero jumps, sags or wanders off."""
PULSES_S = tuple(np.geomspace(0.015, 1.2, 16).tolist())
"""How long what returns takes to its peak: a twitch some hundredths of a second, a push a second or so. Densely, since
it begins sharply, and bends little about that."""
PULSE, BENT_PULSES = 2, (1, 3, 4, 5, 6)
"""Orders of pulses that return, the one and those by which it may go otherwise: together any that is over in time."""
LASTS = 15.0
"""Times of its rise after which no more than a millionth of such a pulse is left."""


@dataclass(frozen=True)
class Event:
    """A kind of step: how it acts, its unit, and its forms: how long it may take (s).

    One that ``returns`` is a pulse that rises for so long, and then dies away; one that ``goes_on`` may still do so
    when rest ends. What is the ``channel``'s own is a step of its gain, or of its zero, either way. No law of the
    library does so.
    """

    name: str
    acts: Acts
    unit: float
    rises_s: tuple[float, ...]
    phases: tuple[str, ...]
    returns: bool = False
    channel: bool = False
    goes_on: bool = False

    @property
    def one_sided(self) -> bool:
        """Whether it has one sign only: a share of the contact is lost, not won."""
        return self.acts == "share" and not self.channel

    @property
    def once(self) -> bool:
        """Whether it comes once in a trial, as the library has it; what has no name there may come twice."""
        return self.name in library()

    @property
    def looked_at(self) -> int:
        """In how many places of a trial it is looked for: where either sign is as likely, each is one."""
        return TIMES_LOOKED_AT * (2 if self.channel else 1)


@dataclass(frozen=True)
class EventScan:
    """What all trials say of one kind of step: evidence in nats, share of trials, size, and each trial's own (n,).

    ``times_s`` and ``coefficients`` are the most probable time and size (in the unit of the state) of a step there.
    Where it is what took the skin off a punch that dwells on it, ``gaps_mm`` is by how much.
    """

    event: Event
    evidence: float
    share: float
    size: float
    probability: FloatArray
    times_s: FloatArray
    forms: FloatArray
    gaps_mm: FloatArray
    coefficients: FloatArray


EVENTS = (
    Event("slip", "share", 1.0, SLIPS_S, ("hold",)),
    Event("motion_artefact", "surface", 1e-3, SHIFTS_S, ("dwell", "hold")),
    Event("swell", "surface", 1e-3, SWELLS_S, ("dwell", "hold"), goes_on=True),
    Event("transient", "surface", 1e-3, PULSES_S, ("dwell", "hold"), returns=True),
    Event("jump", "share", 1.0, SLIPS_S, ("hold",), channel=True),
    Event("zero_step", "force", 1.0, ZEROS_S, ("approach", "dwell", "hold", "clear"), channel=True),
)
SETTLES_S = (0.03, 0.5, 3.0)
CREEP = "creep"
SETTLES = 0.1
"""No step stays exactly as it was: it may creep by a tenth of its size with these times.

A drop is as large as it is at once. Skin that shifts may swing too far for the first of them: that is not its size.
"""


def step_shape(trial: CellTrial, time_s: float, rise_s: float) -> FloatArray:
    """Return a step (n,) from 0 to 1 about a time, as the mean over each cell of a ramp of ``rise_s``."""
    half = 0.5 * trial.widths_s

    def integral(t: FloatArray) -> FloatArray:
        u = np.clip(t / rise_s + 0.5, 0.0, 1.0)
        return 0.5 * rise_s * u**2 + np.maximum(t - 0.5 * rise_s, 0.0)

    since = trial.time_s - time_s
    return np.asarray((integral(since + half) - integral(since - half)) / (2.0 * half))


def event_shape(event: Event, trial: CellTrial, time_s: float, rise_s: float) -> FloatArray:
    """Return what an event of size 1 does (n,): a step, or a pulse about its peak."""
    if event.returns:
        return np.asarray(pulse_shapes(trial, time_s, rise_s, (PULSE,))[0])
    return step_shape(trial, time_s, rise_s)


def pulse_shapes(trial: CellTrial, peak_s: float, rise_s: float, orders: Sequence[int]) -> FloatArray:
    """Return pulses (K, n) that are nothing before they begin and die away by and by, as means over cells.

    p_n(r) = (2 r / n)^n e^(n - 2 r), r the time since the beginning in units of the rise: what n + 1 equal lags in a
    row make of a blow. Together they are Laguerre's functions, of which any pulse is a sum; the second peaks at r = 1.
    """
    r = np.linspace(0.0, LASTS, 3001)
    half = 0.5 * trial.widths_s
    before, after = (1.0 + (trial.time_s - peak_s + sign * half) / rise_s for sign in (-1.0, 1.0))
    pulses = [(2.0 * r / n) ** n * np.exp(n - 2.0 * r) for n in orders]
    return means_over_cells(np.array(pulses), r, before, after)


def means_over_cells(shapes: FloatArray, at: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the means (K, n) of shapes (K, m), given at places (m,), from each cell's beginning (n,) to its end."""
    area = np.cumsum(shapes, axis=1) * (at[1] - at[0])
    return np.array([np.interp(after, at, a) - np.interp(before, at, a) for a in area]) / (after - before)


def bent_shapes(event: Event, trial: CellTrial, time_s: float, rise_s: float) -> FloatArray:
    """Return how an event may go otherwise (BENT, n), as means over cells; each is nothing before.

    Speeds of a step within -1 < u < 1 are those of a smooth one, (1 - u^2)^2, less the ramp's own, and that times u^k
    less what would be a step: they are nothing after it either. What returns is a sum of pulses.
    """
    if event.returns:
        return pulse_shapes(trial, time_s, rise_s, BENT_PULSES)
    half_s = 0.5 * STRETCH * rise_s
    u = np.linspace(-1.0, 1.0, 801)
    smooth = (1.0 - u**2) ** 2
    ramp = (np.abs(u) < 1.0 / STRETCH).astype(float)
    speeds = [smooth / smooth.sum() - ramp / ramp.sum()]
    for k in range(1, BENT):
        bent = smooth * u**k
        speeds.append((bent - smooth * bent.sum() / smooth.sum()) / np.abs(bent).sum())
    half = 0.5 * trial.widths_s
    before, after = ((trial.time_s - time_s + sign * half) / half_s for sign in (-1.0, 1.0))
    return means_over_cells(np.cumsum(speeds, axis=1), u, before, after)


def one_unit(event: Event, trial: CellTrial, force_mn: FloatArray) -> float:
    """Return what a unit of an event is in that of its shape: a drop (mN) is lost as a share of the hold's force."""
    if event.acts != "share":
        return 1.0
    return 1.0 / max(float(np.median(force_mn[trial.in_phase("hold")])), 1e-9)


def drop_goes_on(trial: CellTrial, state: TrialState, force_mn: FloatArray, time_s: float) -> FloatArray:
    """Return what the surface may do (2, n) after a drop by one unit, besides: nothing at once.

    In the hold the drop may relax as after a step of the surface, or not; as the punch lifts off it may go with the
    force, or with the depth, or stay. By the time the tissue has relaxed, and the force is gone, each is of size 1.
    """
    tissue = state.tissue
    since = np.maximum(trial.time_s - time_s, 0.0)
    stiffness = trial.punch_ratio * tissue.stiffness
    stays = 1.0 / (trial.punch_ratio * tissue.stiffness_after(since)) - 1.0 / stiffness
    last = np.flatnonzero(trial.in_phase("hold"))[-1]
    lifted_mm = np.where(trial.retracting, trial.position_mm[last] - trial.position_mm, 0.0)
    lifted = np.clip(lifted_mm / max(float(force_mn[last]), 1e-9), 0.0, 1.0 / stiffness)
    return -np.array([stays, lifted])


def with_events(fit: StudyFit, scan: EventScan) -> StudyFit:
    """Return the fit with a step in every trial that more likely has one than not, free to creep a little.

    No more is known of what becomes of a drop as the punch lifts off: it may go with the force, stay, or go with the
    depth, and the tissue would be bent to bring the contact's end to where it was. What is the channel's own may be of
    its gain or of its zero.
    """
    name, acts = scan.event.name, scan.event.acts
    states = []
    for j, (trial, state) in enumerate(zip(fit.trials, fit.states, strict=True)):
        if scan.probability[j] <= 0.5:
            states.append(state)
            continue
        time_s, rise_s = float(scan.times_s[j]), scan.event.rises_s[int(scan.forms[j])]
        contact_mn = fit.force_mn(j) - state.offset_mn
        unit = one_unit(scan.event, trial, contact_mn)
        size = max(scan.size, abs(float(scan.coefficients[j])))
        step = event_shape(scan.event, trial, time_s, rise_s) * unit
        since = np.maximum(trial.time_s - time_s, 0.0)
        shapes = [OwnShape(name, acts, step, size**2, time_s)]
        if scan.event.channel and acts == "share":
            shapes.append(OwnShape(name, "force", step / unit, size**2, time_s, CREEP))
        elif not (scan.event.channel or scan.event.returns):
            settles = [step * -np.expm1(-since / t) for t in SETTLES_S]
            settles[0] = settles[0] if scan.event.one_sided else step - settles[0]
            shapes += [OwnShape(name, acts, s, (SETTLES * size) ** 2, time_s, CREEP) for s in settles]
        shapes += [
            OwnShape(name, acts, bent * unit, size**2, time_s, CREEP)
            for bent in bent_shapes(scan.event, trial, time_s, rise_s)
        ]
        if scan.event.one_sided:
            shapes += [
                OwnShape(name, "surface", later, size**2, time_s, CREEP)
                for later in drop_goes_on(trial, state, contact_mn, time_s)
            ]
        # where a step took the skin away, the contact was nearer before
        nearer_mm = float(scan.coefficients[j]) if scan.gaps_mm[j] > 0.0 else 0.0
        there = replace(state, z0_mm=state.z0_mm + nearer_mm)
        states.append(there.with_shapes(shapes, float(scan.coefficients[j])))
    return replace(fit, states=tuple(states))
