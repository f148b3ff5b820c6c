"""What no law of the library has the shape of: lines and tones, single samples far off, gains in a trend."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, poisson

from analysis.mismatch.gain_step import gain_step
from analysis.mismatch.joint import JointFit
from analysis.mismatch.oscillations import stray_lines
from analysis.mismatch.problem import Problem
from analysis.mismatch.trial_order import order_trend
from analysis.mismatch.wandering_tone import wandering_tone
from analysis.mismatch.weighing import quiet_residuals
from analysis.recordings.trial import PHASE_NAMES
from analysis.simulation.cells import MOVING_MM_S, CellTrial

FloatArray = NDArray[np.float64]

STRAY_LEVEL = 2e-4
LINES_ABOVE_HZ = 15.0
FAR_OFF = ((6.0, 5e-3), (12.0, 5e-5))
"""How far single samples lie off, in standard deviations, and how many do in a study where nothing strays."""
HUM_WANDERS_HZ = 0.6
HOLLOW_UP_TO = 3.0


@dataclass(frozen=True, slots=True)
class Stray:
    """Something unexplained that does not repeat at one place: its channel, words, size and significance.

    ``rms`` is in mN or mm by ``signal``; ``start_s`` and ``stop_s`` the medians over trials of where it shows;
    ``phase`` the phase that holds most of it; ``frequency_hz`` that of a line, else 0.
    """

    signal: Literal["force", "position"]
    words: str
    phase: str
    start_s: float
    stop_s: float
    rms: float
    p_value: float
    frequency_hz: float = 0.0


def find_strays(problem: Problem, fit: JointFit) -> tuple[Stray, ...]:
    """Return what is left after a fit in force and position that no window of the residual shows."""
    trials = problem.trials
    rate = problem.common_rate_hz
    force = [problem.full_residual(fit, j) for j in range(len(trials))]
    found: list[Stray] = []
    additions = fit.simulation.additions
    hums = [a.hum.frequency_hz for a in additions if a.hum is not None]
    waves_hz = [
        a.values["frequency_hz"] for a in additions if a.mechanism.form == "oscillation" and a.hum is None
    ]
    at_rest = [_kinks_taken_out(r, t) for r, t in zip(force, trials, strict=True)]
    lines = _lines("force", at_rest, trials, rate) if rate is not None else []
    # what is left of a line that was named is its remainder, not news
    lines = [s for s in lines if not any(_is_of(s.frequency_hz, f) for f in hums)]
    # and a wave free to swell takes noise away on both its sides: beside that hollow, noise looks like a line
    found += [s for s in lines if all(s.frequency_hz > HOLLOW_UP_TO * f for f in waves_hz)]
    found += _far_off("force", force, trials)
    found += _wandering(problem, fit) + _in_order(problem, fit) + _gain_step(problem, fit)
    with_command = [t for t in trials if t.has_command]
    if with_command:
        position = [_bridged(t) for t in with_command]
        found += _lines("position", position, with_command, rate) if rate is not None else []
        found += _far_off("position", position, with_command)
    return tuple(found)


def _wandering(problem: Problem, fit: JointFit) -> list[Stray]:
    rate = problem.common_rate_hz
    if rate is None:
        return []
    tone = wandering_tone(quiet_residuals(problem, fit), rate)
    if tone is None or tone.p_value >= STRAY_LEVEL:
        return []
    words = f"a tone that wanders between {tone.lower_hz:.0f} and {tone.upper_hz:.0f} Hz"
    return [Stray("force", words, *_longest_phase(problem.trials), tone.rms, tone.p_value)]


def _in_order(problem: Problem, fit: JointFit) -> list[Stray]:
    trend = order_trend(problem, fit)
    if trend is None or trend.p_value >= STRAY_LEVEL:
        return []
    words = (
        f"the force's size changes with the order of the trials, by {100 * trend.per_study:+.2g} % over all"
    )
    return [Stray("force", words, *_longest_phase(problem.trials), trend.rms_mn, trend.p_value)]


def _gain_step(problem: Problem, fit: JointFit) -> list[Stray]:
    step = gain_step(problem, fit)
    if step is None or step.p_value >= STRAY_LEVEL:
        return []
    words = f"from one moment on all force is larger or smaller by a share, unlike {step.instead_of}"
    return [Stray("force", words, "hold", step.start_s, step.stop_s, step.rms_mn, step.p_value)]


def _longest_phase(trials: Sequence[CellTrial]) -> tuple[str, float, float]:
    """Return the phase that most samples are in, 0, and the time at which the middle trial ends, s."""
    longest = max(PHASE_NAMES, key=lambda name: float(trials[0].counts[trials[0].in_phase(name)].sum()))
    return longest, 0.0, float(np.median([t.time_s[-1] for t in trials]))


def _is_of(frequency_hz: float, hum_hz: float) -> bool:
    """Tell whether a line is the hum itself or a harmonic of it, as far as hum wanders."""
    harmonic = max(1, round(frequency_hz / hum_hz))
    return abs(frequency_hz - harmonic * hum_hz) < HUM_WANDERS_HZ * harmonic


def _kinks_taken_out(residual: FloatArray, trial: CellTrial) -> FloatArray:
    """Return a force residual (N,) with nothing in motion or about kinks, where what rings is no line of its own."""
    moving = (np.abs(trial.velocity_mm_s) > MOVING_MM_S) & (trial.kind != "air_sweep")
    quick = ((trial.counts == 1) | moving) & trial.fitted
    left = residual.copy()
    left[np.repeat(quick[trial.fitted], trial.counts[trial.fitted].astype(np.int64))] = 0.0
    return left


def _bridged(trial: CellTrial) -> FloatArray:
    """Return the position residual, straight where the arm is accelerated: there the servo has a signature."""
    left = trial.full_servo_residual_mm.astype(np.float64)
    moving = np.repeat(np.abs(trial.acceleration_mm_s2) > 50.0, trial.counts.astype(np.int64))
    if moving.all():
        return np.zeros_like(left)
    left[moving] = np.interp(np.flatnonzero(moving), np.flatnonzero(~moving), left[~moving])
    return left


def _lines(
    signal: Literal["force", "position"],
    residuals: Sequence[FloatArray],
    trials: Sequence[CellTrial],
    rate: float,
) -> list[Stray]:
    lines = [line for line in stray_lines(residuals, rate, LINES_ABOVE_HZ) if line[2] < STRAY_LEVEL]
    if not lines:
        return []
    frequency, rms, p = min(lines, key=lambda line: line[2])
    words = f"a line at {frequency:.4g} Hz"
    return [Stray(signal, words, *_longest_phase(trials), rms, p, frequency)]


def _far_off(
    signal: Literal["force", "position"], residuals: Sequence[FloatArray], trials: Sequence[CellTrial]
) -> list[Stray]:
    """Count samples that lie far off: several by six robust standard deviations, or a single one by twelve.

    A kink's neighbourhood does not count, nor force on the way back: the sample at which skin lets go no law foretells.
    """
    total = 0
    off, sizes, where = [], [], []
    for trial, r in zip(trials, residuals, strict=True):
        plain = trial.fitted & (trial.counts > 1)
        if signal == "force":
            plain &= ~(trial.retracting & (np.abs(trial.velocity_mm_s) > MOVING_MM_S))
        at_rest = np.repeat(plain, trial.counts.astype(np.int64))
        if signal == "force":
            at_rest = at_rest[np.repeat(trial.fitted, trial.counts.astype(np.int64))]
        jump = np.abs(r[1:-1] - 0.5 * (r[:-2] + r[2:]))
        # one sample that is off makes its neighbours jump by half as much
        beside = np.maximum(np.pad(jump, (1, 0))[:-1], np.pad(jump, (0, 1))[1:])
        peak = (jump >= beside)[at_rest[1:-1]]
        jump = jump[at_rest[1:-1]]
        if len(jump) < 100:
            continue
        # by a quantile, not the median: a converter's steps make half of the jumps smaller than they are
        sigma = max(float(np.quantile(jump, 0.954)) / 2.0, 1e-12)
        far = peak & (jump > FAR_OFF[0][0] * sigma)
        total += len(jump)
        off.extend((jump[far] / sigma).tolist())
        sizes.extend(jump[far].tolist())
        where.extend((np.flatnonzero(at_rest)[np.flatnonzero(far)] / trial.sample_rate_hz).tolist())
    p = 1.0
    for beyond, anyway in FAR_OFF:
        count = sum(x > beyond for x in off)
        expected = 2.0 * norm.sf(beyond) * total * 3.0 + anyway
        p = min(p, len(FAR_OFF) * float(poisson.sf(count - 1, expected)) if count else 1.0)
    if p >= STRAY_LEVEL:
        return []
    rms = float(np.sqrt(np.mean(np.square(sizes))))
    unit = "mN" if signal == "force" else "mm"
    single = "a single sample" if len(off) == 1 else f"{len(off)} single samples"
    words = f"{single} far off the others, by {rms:.2g} {unit}"
    middle = float(np.median(where))
    trial = trials[0]
    cell = int(np.clip(np.searchsorted(trial.time_s, middle), 0, len(trial.time_s) - 1))
    phase = PHASE_NAMES[int(trial.phase[cell])] if trial.phase[cell] >= 0 else "hold"
    return [Stray(signal, words, phase, float(min(where)), float(max(where)), rms, p)]
