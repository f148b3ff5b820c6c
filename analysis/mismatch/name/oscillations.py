"""Oscillations of the surface with a phase of their own in every trial: breath, pulse, tremor, or any frequency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from analysis.mismatch.evidence.marginal import log_ratio
from analysis.mismatch.fit.rhythms import with_rhythm
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import INEXACT
from analysis.mismatch.model.effects import OwnShape, touches
from analysis.mismatch.model.rhythm import CYCLES, HARMONIC, HIGHEST_HZ, Rhythm, overtones, sine, waves
from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import Mechanism, library

FloatArray = NDArray[np.float64]

LOWEST_HZ = 0.15
COHERENT_S, COHERENT_CYCLES = 3.0, 5.0
"""Where rhythms are looked for they keep their phase and size for so long, and what is quicker for so many cycles."""
MANY_CYCLES = 6.0
"""A rhythm that goes round so often in a trial is a narrow band: noise of the surface with a covariance, whose size and
steadiness its cycles tell. Of a slower one a trial holds too few for that, and the few shapes it has are its own."""
SPACING = 0.45
"""Of the width of a line: frequencies are looked at so densely."""
WANDERS = 0.06
"""A body's rhythm differs by so much between trials."""
SIZES = np.geomspace(3.0, 3e3, 9)
UNKNOWN_SIZE = 1.5
WANDERING = "wandering"
NAMELESS = "oscillation"
"""An oscillation in no band of the library."""
TUNED, TUNED_SHARE = 25, 0.15
"""Frequencies tried about a scanned one, no further away than this share of it and what a body's differ by."""


@dataclass(frozen=True)
class OscillationScan:
    """What all trials say of a surface that oscillates: evidence in nats, frequency and size."""

    evidence: float
    frequency_hz: float
    size_mm: float
    name: str
    grid_hz: FloatArray


def coherent_s(frequency_hz: float) -> float:
    """Return for how long a rhythm keeps its phase and size where it is looked for, s."""
    return min(COHERENT_S, COHERENT_CYCLES / frequency_hz)


def wanders_s(frequency_hz: float) -> float:
    """Return the same, but no less than a cycle or so, s."""
    return max(coherent_s(frequency_hz), CYCLES / frequency_hz)


def hat_waves(trial: CellTrial, frequency_hz: float, number: int = 1) -> FloatArray:
    """Return cosine and sine (n, 2h) of an overtone on hat functions between which amplitude and phase wander."""
    t = trial.time_s
    length = float(t[-1] - t[0])
    count = max(1, round(length / wanders_s(frequency_hz)))
    hats = np.ones((1, len(t)))
    if count > 1:
        at = np.linspace(t[0], t[-1], count + 1)
        hats = np.maximum(0.0, 1.0 - np.abs(t - at[:, None]) * count / length)
    cosine, sinus = sine(trial, number * frequency_hz).T
    return np.vstack([hats * cosine, hats * sinus]).T


def name_of(frequency_hz: float) -> str:
    """Return the mechanism whose band holds a frequency; `NAMELESS` where the library has none."""
    for m in library().values():
        if m.form == "oscillation" and m.needs_contact:
            lowest_hz, highest_hz = band_hz(m)
            if lowest_hz <= frequency_hz <= highest_hz:
                return m.name
    return NAMELESS


def band_hz(mechanism: Mechanism) -> tuple[float, float]:
    """Return the lowest and the highest frequency of a rhythm's band, which wanders as a body's does."""
    p = mechanism.parameter("frequency_hz")
    return p.lower * (1.0 - WANDERS), p.upper * (1.0 + WANDERS)


def frequency_grid(length_s: float, highest_hz: float = HIGHEST_HZ) -> FloatArray:
    """Return the frequencies at which lines of this length are looked for, Hz."""
    found, f = [], LOWEST_HZ
    while f < highest_hz:
        found.append(f)
        f += SPACING / min(length_s, max(coherent_s(f), 2.0 * CYCLES / f))
    return np.array(found)


def scan_oscillations(fit: StudyFit, only: str = "") -> OscillationScan:
    """Weigh a surface that oscillates at every frequency, or in the band of what is called ``only``, amplitudes
    integrated out.

    The price of a frequency is that of all, as any might have been found.
    """
    skin = _on_skin(fit)
    every = frequency_grid(_length_s(fit), _highest_hz(fit)) if skin else np.zeros(0)
    grid = np.array([f for f in every if only in ("", name_of(f))])
    nothing = OscillationScan(-np.inf, 0.0, 0.0, only, every)
    if not len(grid):
        return nothing
    energies: list[list[tuple[FloatArray, FloatArray]]] = []
    stiffness = []
    for j in skin:
        stiffness.append(fit.trials[j].punch_ratio * fit.states[j].tissue.stiffness)
        energies.append(_energies(fit, j, grid.tolist()))
    # what a slow rhythm has fewer of than a quick one stays nothing
    a = np.zeros((len(skin), len(grid), max(len(v) for own in energies for v, _ in own)))
    c2 = np.zeros_like(a)
    for at, own in enumerate(energies):
        for k, (values, squares) in enumerate(own):
            a[at, k, : len(values)], c2[at, k, : len(values)] = values, squares
    shown = a.max(axis=2)
    if not np.median(shown) > 0.0:  # nothing touches, or samples are too far apart for any of them
        return nothing
    typical = 1.0 / np.sqrt(float(np.median(shown)))
    best = nothing
    for strength in SIZES:
        v = (float(strength) * typical) ** 2
        ratio = log_ratio(a, c2, v).sum(axis=2)
        profile = np.zeros(len(grid))
        for k, f in enumerate(grid):
            near = np.flatnonzero(np.abs(grid - f) <= WANDERS * f + 1e-9)
            profile[k] = float((logsumexp(ratio[:, near], axis=1) - np.log(len(near))).sum())
        whole = float(logsumexp(profile) - np.log(len(every))) - UNKNOWN_SIZE
        if whole > best.evidence:
            k = int(np.argmax(profile))
            size_mm = float(np.sqrt(v)) / float(np.median(stiffness))
            best = OscillationScan(whole, float(grid[k]), size_mm, only, every)
    if only or best is nothing:
        return best
    # the places looked at are further apart than bands are sharp
    return replace(best, name=name_of(float(np.median(list(tuned_hz(fit, best).values())))))


def _on_skin(fit: StudyFit) -> list[int]:
    """Return which trials are on skin."""
    return [j for j, t in enumerate(fit.trials) if t.kind == "ramp_hold_retract"]


def _skin_times_s(fit: StudyFit) -> list[FloatArray]:
    """Return the times (n,) of the cells of each trial on skin, s."""
    return [fit.trials[j].time_s for j in _on_skin(fit)]


def _length_s(fit: StudyFit) -> float:
    """Return how long a trial on skin lasts, the median, s."""
    return float(np.median([t[-1] - t[0] for t in _skin_times_s(fit)]))


def _highest_hz(fit: StudyFit) -> float:
    """Return the frequency of which cells are two a cycle, by their mean rate in every trial on skin, Hz."""
    return min(HIGHEST_HZ, *(0.5 * len(t) / float(t[-1] - t[0]) for t in _skin_times_s(fit)))


def _energies(fit: StudyFit, j: int, frequencies_hz: Sequence[float]) -> list[tuple[FloatArray, FloatArray]]:
    """Return the eigenvalues of each rhythm's information in the j-th trial, and its squared scores along them."""
    trial, projector = fit.trials[j], fit.projectors[j]
    touching = touches(trial, fit.states[j], fit.shared)
    own = []
    for f in frequencies_hz:
        white = projector(hat_waves(trial, f) * touching[:, None])
        values, vectors = np.linalg.eigh(white.T @ white)
        own.append((np.maximum(values, 0.0), (projector.residual @ white @ vectors) ** 2))
    return own


def tuned_hz(fit: StudyFit, scan: OscillationScan) -> dict[int, float]:
    """Return the frequency of each trial on skin about the scanned one at which a steady rhythm does best.

    A body's differ by `WANDERS` between trials: each is drawn from about one of the study, the likeliest of all. Its
    form is right to a tenth: what explains so much less is as likely as what is one standard deviation away. So few
    cycles tell little of their frequency, where another effect that is still missing would have it anywhere, but for
    where none is looked for.
    """
    at_hz = scan.frequency_hz
    reach_hz = WANDERS * at_hz + min(SPACING / coherent_s(at_hz), TUNED_SHARE * at_hz)
    tried_hz = np.linspace(max(at_hz - reach_hz, LOWEST_HZ * (1.0 - WANDERS)), at_hz + reach_hz, TUNED)
    skin = _on_skin(fit)
    gains = np.array([steady_gains(fit, j, tried_hz, scan.size_mm) for j in skin])
    away = (tried_hz - tried_hz[:, None]) / (WANDERS * tried_hz[:, None])
    likely = gains / np.maximum(INEXACT * gains.max(axis=1, keepdims=True), 1.0) - away[:, None, :] ** 2
    of_study = int(np.argmax(likely.max(axis=2).sum(axis=1)))
    return dict(zip(skin, tried_hz[likely[of_study].argmax(axis=1)].tolist(), strict=True))


def steady_gains(
    fit: StudyFit, j: int, frequencies_hz: FloatArray, size_mm: float, *, overtones: bool = True
) -> FloatArray:
    """Return the chi2 (F,) of the j-th trial that a steady rhythm explains at each frequency, or its sine alone."""
    trial, state = fit.trials[j], fit.states[j]
    touching = touches(trial, state, fit.shared)
    stiffness = trial.punch_ratio * state.tissue.stiffness
    gains = []
    for f in frequencies_hz.tolist():
        carried = waves(trial, f)[:, : None if overtones else 2]
        white = fit.projectors[j](stiffness * size_mm * carried * touching[:, None])
        score = fit.projectors[j].residual @ white
        gains.append(float(score @ np.linalg.solve(white.T @ white + np.eye(len(score)), score)))
    return np.array(gains)


def with_oscillation(fit: StudyFit, scan: OscillationScan) -> StudyFit:
    """Return the fit with every trial's surface free to oscillate about its frequency, while it is touched."""
    states = list(fit.states)
    is_band = scan.frequency_hz * _length_s(fit) >= MANY_CYCLES
    for j, hz in tuned_hz(fit, scan).items():
        trial, state = fit.trials[j], fit.states[j]
        if is_band:
            states[j] = with_rhythm(
                trial, state, fit.shared, Rhythm(scan.name, hz, scan.size_mm, wanders_s(hz))
            )
        else:
            touching = touches(trial, state, fit.shared)
            states[j] = state.with_shapes(_slow_shapes(trial, touching, scan.name, hz, scan.size_mm))
    return replace(fit, states=tuple(states)).weighed_by(fit.noise)


def _slow_shapes(
    trial: CellTrial, touching: NDArray[np.bool_], name: str, hz: float, size_mm: float
) -> list[OwnShape]:
    """Return the shapes of a rhythm of few cycles, which is there while the surface is touched.

    One that hat functions leave steady still wanders: by a share of `WANDERS` quicker or slower it is ahead or behind
    by 2 pi f T WANDERS / 2 at either end of the T in which it shows, and its size may go with time by as much. A rate
    that changes evenly by that share either way bends its phase by a third of that, times Legendre's parabola.
    """
    carried = {number: hat_waves(trial, hz, number).T for number in overtones(hz)}
    shapes = [
        OwnShape(name, "surface", w, (share * size_mm) ** 2, number * hz, HARMONIC if number > 1 else "")
        for number, share in overtones(hz).items()
        for w in carried[number]
        if np.any(w[touching])
    ]
    if len(carried[1]) > 2 or np.count_nonzero(touching) < 2:
        return shapes
    first_s, last_s = trial.time_s[touching][[0, -1]]
    ends = np.pi * hz * (last_s - first_s) * WANDERS
    from_middle = (2.0 * trial.time_s - first_s - last_s) / (last_s - first_s)
    parabola = 1.5 * from_middle**2 - 0.5
    return shapes + [
        OwnShape(name, "surface", w * course, (share * ends * size_mm) ** 2, hz, WANDERING)
        for course, share in ((from_middle, 1.0), (parabola, 1.0 / 3.0))
        for w in carried[1]
    ]
