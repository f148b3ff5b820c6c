"""Oscillations of the surface with a phase of their own in every trial: breath, pulse, tremor, or any frequency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from analysis.mismatch.evidence.marginal import log_ratio
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import INEXACT
from analysis.mismatch.model.effects import OwnShape, touches
from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import library

FloatArray = NDArray[np.float64]

LOWEST_HZ, HIGHEST_HZ = 0.15, 15.0
COHERENT_S, COHERENT_CYCLES = 3.0, 5.0
"""Pulse and breath keep their phase and size for about so long, and what is quicker for so many cycles."""
STEADY_CYCLES = (COHERENT_CYCLES, COHERENT_CYCLES / 2.0, COHERENT_CYCLES / 4.0)
"""Or for less: what moves in a narrow band has no phase of its own."""
SPACING = 0.45
"""Of the width of a line: frequencies are looked at so densely."""
WANDERS = 0.06
"""A body's rhythm differs by so much between trials."""
SIZES = np.geomspace(3.0, 3e3, 9)
UNKNOWN_SIZE = 1.5
HARMONIC = "harmonic"
OVERTONES = {2: 0.3, 3: 0.15, 4: 0.1}
"""A body's rhythm is no sine: it has overtones of some such shares of its size, no steadier than itself."""
TUNED, TUNED_SHARE = 15, 0.15
"""Frequencies tried about a scanned one, no further away than this share of it."""
CYCLES = 1.25
"""No rhythm is steadier than a cycle or so, or faster to change."""


@dataclass(frozen=True)
class OscillationScan:
    """What all trials say of a surface that oscillates: evidence in nats, frequency and size, each trial's own.

    It keeps its phase and size for ``cycles``.
    """

    evidence: float
    by_trial: FloatArray
    frequency_hz: float
    own_hz: FloatArray
    size_mm: float
    name: str
    profile: FloatArray
    grid_hz: FloatArray
    cycles: float = COHERENT_CYCLES


def coherent_s(frequency_hz: float, cycles: float = COHERENT_CYCLES) -> float:
    """Return for how long a rhythm keeps its phase and size, s."""
    return min(COHERENT_S, cycles / frequency_hz)


def knots(trial: CellTrial, frequency_hz: float, cycles: float) -> FloatArray:
    """Return hat functions (h, n) between which amplitude and phase wander; one that is constant for slow ones."""
    t = trial.time_s
    length = float(t[-1] - t[0])
    count = max(1, round(length / max(coherent_s(frequency_hz, cycles), CYCLES / frequency_hz)))
    if count == 1:
        return np.ones((1, len(t)))
    at = np.linspace(t[0], t[-1], count + 1)
    return np.maximum(0.0, 1.0 - np.abs(t - at[:, None]) * count / length)


def waves(
    trial: CellTrial, frequency_hz: float, number: int = 1, cycles: float = COHERENT_CYCLES
) -> FloatArray:
    """Return cosine and sine of an overtone on every hat of the rhythm, (2h, n), averaged over the cells."""
    phase = 2.0 * np.pi * number * frequency_hz * trial.time_s
    blur = np.sinc(number * frequency_hz * trial.widths_s)
    hats = knots(trial, frequency_hz, cycles)
    return np.vstack([hats * np.cos(phase) * blur, hats * np.sin(phase) * blur])


def name_of(frequency_hz: float) -> str:
    """Return the mechanism whose band holds a frequency; empty where the library has none."""
    for m in library().values():
        if m.form == "oscillation" and m.needs_contact:
            p = m.parameter("frequency_hz")
            if p.lower * (1 - WANDERS) <= frequency_hz <= p.upper * (1 + WANDERS):
                return m.name
    return ""


def frequency_grid(length_s: float) -> FloatArray:
    """Return the frequencies at which lines of this length are looked for, Hz."""
    found, f = [], LOWEST_HZ
    while f < HIGHEST_HZ:
        found.append(f)
        f += SPACING / min(length_s, max(coherent_s(f), 2.0 * CYCLES / f))
    return np.array(found)


def scan_oscillations(fit: StudyFit) -> OscillationScan:
    """Weigh a surface that oscillates at every frequency, amplitudes integrated out."""
    skin = [j for j, t in enumerate(fit.trials) if t.kind == "ramp_hold_retract"]
    n = len(fit.trials)
    lengths = [float(fit.trials[j].time_s[-1] - fit.trials[j].time_s[0]) for j in skin]
    grid = frequency_grid(float(np.median(lengths))) if skin else np.zeros(0)
    nothing = OscillationScan(-np.inf, np.zeros(n), 0.0, np.zeros(n), 0.0, "", np.zeros(0), grid)
    if not len(grid):
        return nothing
    energies: list[list[tuple[FloatArray, FloatArray]]] = []
    stiffness = []
    for j in skin:
        s = fit.states[j].tissue
        stiffness.append(s.k0 + s.k1 + s.k2)
        energies.append(_energies(fit, j, grid.tolist(), COHERENT_CYCLES))
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
        spread = np.zeros_like(ratio)
        for k, f in enumerate(grid):
            near = np.flatnonzero(np.abs(grid - f) <= WANDERS * f + 1e-9)
            spread[:, k] = logsumexp(ratio[:, near], axis=1) - np.log(len(near))
            profile[k] = float(spread[:, k].sum())
        whole = float(logsumexp(profile) - np.log(len(grid))) - UNKNOWN_SIZE
        if whole > best.evidence:
            k = int(np.argmax(profile))
            near = np.flatnonzero(np.abs(grid - grid[k]) <= WANDERS * grid[k] + 1e-9)
            by_trial, own_hz = np.zeros(n), np.full(n, float(grid[k]))
            by_trial[skin] = spread[:, k]
            own_hz[skin] = grid[near[np.argmax(ratio[:, near], axis=1)]]
            best = OscillationScan(
                whole,
                by_trial,
                float(grid[k]),
                own_hz,
                float(np.sqrt(v)) / float(np.median(stiffness)),
                name_of(float(grid[k])),
                profile,
                grid,
            )
    return _as_steady(fit, best, skin, [float(s) * typical for s in SIZES])


def _energies(
    fit: StudyFit, j: int, frequencies_hz: Sequence[float], cycles: float
) -> list[tuple[FloatArray, FloatArray]]:
    """Return the eigenvalues of each rhythm's information in the j-th trial, and its squared scores along them."""
    trial, projector = fit.trials[j], fit.projectors[j]
    touching = touches(trial, fit.states[j], fit.shared)
    own = []
    for f in frequencies_hz:
        white = projector((waves(trial, f, cycles=cycles) * touching).T)
        values, vectors = np.linalg.eigh(white.T @ white)
        own.append((np.maximum(values, 0.0), (projector.residual @ white @ vectors) ** 2))
    return own


def _as_steady(
    fit: StudyFit, scan: OscillationScan, skin: Sequence[int], sizes: Sequence[float]
) -> OscillationScan:
    """Return the scan as steady as explains what the likeliest does, but for what a law right to a tenth leaves."""
    if not scan.evidence > 0.0:
        return scan
    nats = []
    for cycles in STEADY_CYCLES:
        own = [_energies(fit, j, [float(scan.own_hz[j])], cycles)[0] for j in skin]
        nats.append(max(sum(float(log_ratio(a, c2, size**2).sum()) for a, c2 in own) for size in sizes))
    steady = next(c for c, n in zip(STEADY_CYCLES, nats, strict=True) if n >= (1.0 - INEXACT**2) * max(nats))
    return replace(scan, cycles=steady)


def tuned(fit: StudyFit, j: int, near_hz: float, size_mm: float) -> float:
    """Return the frequency about one at which a steady rhythm with its overtones explains most of the j-th trial."""
    trial, state = fit.trials[j], fit.states[j]
    touching = touches(trial, state, fit.shared)
    stiffness = float(state.tissue.k0 + state.tissue.k1 + state.tissue.k2)
    time_s = trial.time_s
    reach_hz = min(SPACING / coherent_s(near_hz), TUNED_SHARE * near_hz)
    tried = near_hz + np.linspace(-1.0, 1.0, TUNED) * reach_hz
    numbers = [n for n in (1, *OVERTONES) if 2.0 * n * near_hz < HIGHEST_HZ] or [1]
    prior = np.repeat([(stiffness * size_mm * OVERTONES.get(n, 1.0)) ** -2 for n in numbers], 2)
    phases = 2.0 * np.pi * np.multiply.outer(time_s, np.outer(tried, numbers).ravel())
    columns = np.stack([np.cos(phases), np.sin(phases)], axis=-1).reshape(len(time_s), -1)
    blur = np.sinc(np.multiply.outer(trial.widths_s, np.outer(tried, numbers).ravel()))
    white = fit.projectors[j](stiffness * size_mm * columns * np.repeat(blur, 2, axis=1) * touching[:, None])
    prior = prior * (stiffness * size_mm) ** 2
    scores = fit.projectors[j].residual @ white
    gains = []
    for k in range(TUNED):
        part = slice(k * len(prior), (k + 1) * len(prior))
        A = white[:, part].T @ white[:, part] + np.diag(prior)
        gains.append(float(scores[part] @ np.linalg.solve(A, scores[part])))
    return float(tried[int(np.argmax(gains))])


def with_oscillation(fit: StudyFit, scan: OscillationScan, name: str) -> StudyFit:
    """Return the fit with every trial's surface free to oscillate at its frequency, while it is touched."""
    states = []
    for j, (trial, state) in enumerate(zip(fit.trials, fit.states, strict=True)):
        if trial.kind != "ramp_hold_retract":
            states.append(state)
            continue
        f = tuned(fit, j, float(scan.own_hz[j]), scan.size_mm)
        touching = touches(trial, state, fit.shared)
        overtones = {n: share for n, share in OVERTONES.items() if 2.0 * n * f < HIGHEST_HZ}
        shapes = []
        for number, share in {1: 1.0, **overtones}.items():
            kind = "" if number == 1 else HARMONIC
            shapes += [
                OwnShape(name, "surface", w, (share * scan.size_mm) ** 2, number * f, kind)
                for w in waves(trial, f, number, scan.cycles)
                if np.any(w[touching])
            ]
        states.append(state.with_shapes(shapes))
    return replace(fit, states=tuple(states))
