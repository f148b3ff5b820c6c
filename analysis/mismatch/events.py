"""Events with a time of their own in every trial: the punch slips, the finger moves once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfc

from analysis.mismatch.joint import Addition, JointFit, column_space, linearise, project_out
from analysis.mismatch.noise import Whitener
from analysis.mismatch.surface_motion import in_contact, surface_force
from analysis.simulation.cells import CellTrial
from analysis.simulation.forward import PerTrial
from analysis.simulation.mechanism import Mechanism, Tissue, library

FloatArray = NDArray[np.float64]

STEP_S = 0.02
MOST_TIMES = 1000
EDGE_S = 0.06
FEWEST_TIMES = 10
STRONGEST_OF_NOISE = 2.2
RISE_S = 0.0015
FADING_S = 0.1


@dataclass(frozen=True)
class EventScan:
    """Standardised scores of a step at each time: one array (times,) a trial; positive is the law's own sign.

    ``widths``: of each trial that was scanned, the strongest score that is left when its strongest step is taken out,
    in units of what white noise has there. Noise that was not weighed as slow as it is has many strong steps, an event
    is one.
    """

    mechanism: Mechanism
    times_s: tuple[FloatArray, ...]
    scores: tuple[FloatArray, ...]
    widths: tuple[float, ...]

    def strongest(self) -> tuple[FloatArray, FloatArray]:
        """Return the score of largest size (T,) and its time (T,) in each trial (0, 0 where nothing was scanned)."""
        best, at = np.zeros(len(self.scores)), np.zeros(len(self.scores))
        for j, (t, s) in enumerate(zip(self.times_s, self.scores, strict=True)):
            if len(s):
                k = int(np.argmax(np.abs(s)))
                best[j], at[j] = s[k], t[k]
        return best, at

    def asymmetry(self) -> FloatArray:
        """Return max(score) - max(-score) of each trial (T,): symmetric about 0 without an event of known sign."""
        return np.array([float(s.max() - (-s).max()) if len(s) else 0.0 for s in self.scores])


def event_mechanisms() -> list[Mechanism]:
    """Return the library's events."""
    return [m for m in library().values() if m.form == "event"]


def event_rows(
    mechanism: Mechanism,
    trial: CellTrial,
    tissue: Tissue,
    own: PerTrial,
    times_s: FloatArray,
    shape: FloatArray | float = 1.0,
) -> FloatArray:
    """Return the force (m, n) of a unit event at each time: 1 mN lost (slip) or 1 um of shift (artefact).

    ``shape`` (n,) multiplies the step.
    """
    after = np.clip((trial.time_s - times_s[:, None]) / RISE_S + 0.5, 0.0, 1.0) * shape
    if mechanism.stage == "contact":
        touching = in_contact(trial, own)
        force_mn = trial.force_mn - own.offset_mn
        held_mn = float(force_mn[np.flatnonzero(touching)[-1]]) if touching.any() else 0.0
        # what let go carries nothing on the way out either: there the loss falls with the force
        leaving = trial.retracting * np.clip(force_mn / max(held_mn, 1e-9), 0.0, 1.0)
        return -after * np.where(touching, 1.0, leaving)
    return surface_force(trial, tissue, own, 1e-3 * after)


def scan_events(
    mechanism: Mechanism, trials: Sequence[CellTrial], whiteners: Sequence[Whitener], fit: JointFit
) -> EventScan:
    """Score a step at every 20 ms, in long holds a thousand times, of the hold (slip) or all contact (artefact)."""
    all_times, all_scores = [], []
    widths: list[float] = []
    for j, (trial, whitener) in enumerate(zip(trials, whiteners, strict=True)):
        own, tissue = fit.own[j], fit.simulation.tissue
        window = trial.in_phase("hold")
        if mechanism.stage != "contact":
            window = window | trial.in_phase("dwell")
        window &= in_contact(trial, own) & trial.fitted
        if trial.kind in ("air_sweep", "rigid_target") or window.sum() < 20:
            all_times.append(np.zeros(0))
            all_scores.append(np.zeros(0))
            continue
        t = trial.time_s[window]
        step_s = max(STEP_S, float(t[-1] - t[0]) / MOST_TIMES)
        # within each stretch at rest, clear of its ends: at a kink of the motion its smoothing looks like a step
        ends = np.flatnonzero(np.diff(t) > EDGE_S)
        firsts, lasts = np.append(t[0], t[ends + 1]), np.append(t[ends], t[-1])
        stretches = zip(firsts, lasts, strict=True)
        times = np.concatenate([np.arange(a + EDGE_S, b - EDGE_S, step_s) for a, b in stretches])
        columns = event_rows(mechanism, trial, tissue, own, times).T
        latent = fit.simulation.latent_columns(trial, own)
        line = linearise(trial, whitener, fit.simulation, own, trials, latent, fit.latents[j])
        # an event in one trial bends the shared parameters for all: here each trial may have its own
        # and only its window counts: what a contact point that is off leaves at the kink of contact is no event
        inside = window[trial.fitted]
        basis = column_space(np.column_stack([line.A, line.J])[inside])
        C, r = whitener(columns)[inside], line.r[inside]
        spanned = basis.T @ C
        norm = np.sqrt(np.maximum(np.einsum("nf,nf->f", C, C) - np.sum(spanned**2, axis=0), 1e-24))
        scores = C.T @ (r - basis @ (basis.T @ r)) / norm
        all_times.append(times)
        all_scores.append(scores)
        if len(scores) >= FEWEST_TIMES:
            k = int(np.argmax(np.abs(scores)))
            rest = scores - (C.T @ C[:, k] - spanned.T @ spanned[:, k]) / (norm * norm[k]) * scores[k]
            widths.append(float(np.max(np.abs(rest))) / STRONGEST_OF_NOISE)
    return EventScan(mechanism, tuple(all_times), tuple(all_scores), tuple(widths))


def event_p_value(scan: EventScan) -> float:
    """Return the chance that the strongest step of any trial is noise.

    Scores are measured in units of the median trial's width, and the tail is taken an eighth wider than Gaussian, so
    that correlated noise does not pass for an event.
    """
    if not scan.widths:
        return 1.0
    strongest = max(float(np.max(np.abs(s))) for s in scan.scores if len(s) >= FEWEST_TIMES)
    looks = sum(len(s) for s in scan.scores)
    return float(
        min(1.0, looks * erfc(strongest / max(1.0, float(np.median(scan.widths))) / 1.12 / np.sqrt(2.0)))
    )


@dataclass(frozen=True)
class EventAt:
    """The columns of an event at its own time in each trial (s, by label).

    Each has two: what lasts, and what is gone after a tenth of a second (skin that sticks again, a finger that swings
    to its new place).
    """

    mechanism: Mechanism
    times_s: Mapping[str, float]

    def __call__(self, trial: CellTrial, tissue: Tissue, own: PerTrial) -> FloatArray:
        """Return the force (n, q) of unit events."""
        at = self.times_s.get(trial.label)
        if at is None:
            return np.zeros((len(trial.time_s), 0))
        fading = np.exp(-np.maximum(trial.time_s - at, 0.0) / FADING_S)
        when = np.array([at])
        return np.column_stack(
            [event_rows(self.mechanism, trial, tissue, own, when, shape)[0] for shape in (1.0, fading)]
        )


def event_addition(mechanism: Mechanism, times_s: Mapping[str, float]) -> Addition:
    """Return an event of free size at its own time in each trial named in ``times_s`` (by label)."""
    median = float(np.median(list(times_s.values())))
    return Addition(mechanism, {**mechanism.null, "time_s": median}, EventAt(mechanism, times_s))


def refine_time(
    mechanism: Mechanism,
    trials: Sequence[CellTrial],
    whitener: Whitener,
    fit: JointFit,
    index: int,
    about_s: float,
) -> float:
    """Return the time of an event to the millisecond, by a finer scan about a first estimate."""
    trial = trials[index]
    latent = fit.simulation.latent_columns(trial, fit.own[index])
    times = about_s + np.arange(-STEP_S, STEP_S + 5e-4, 1e-3)
    own, tissue = fit.own[index], fit.simulation.tissue
    columns = whitener(event_rows(mechanism, trial, tissue, own, times).T)
    line = linearise(trial, whitener, fit.simulation, own, trials, latent, fit.latents[index])
    left, _ = project_out(np.column_stack([line.A, line.J]), np.column_stack([line.r, columns]))
    gain = (left[:, 1:].T @ left[:, 0]) ** 2 / np.maximum((left[:, 1:] ** 2).sum(axis=0), 1e-12)
    return float(times[int(np.argmax(gain))])
