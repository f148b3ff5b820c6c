"""What the arm really did: the recorded motion freed of its measurement noise.

Driving a tissue model with the raw recorded position biases it (0.25 um of noise a sample); what is known
of the servo gives the fast part of the motion, the recording gives what the servo does not explain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, shift
from scipy.optimize import least_squares

from analysis.recordings.trial import Trial
from analysis.simulation.arm_path import (
    NEAR_KINK_S,
    SLOW_SMOOTHING_S,
    VELOCITY_WINDOW_S,
    ArmPath,
    beside_servo,
    near_kinks,
    of_unknown_drive,
    without_command,
)
from analysis.simulation.servo import DEFAULT_DAMPING_RATIO, DEFAULT_NATURAL_FREQUENCY_RAD_S, follow
from analysis.simulation.smoothing import averaged_noise, position_noise
from analysis.simulation.straight import straightened

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LASTING_S = (SLOW_SMOOTHING_S, 0.01, 0.02, 0.04, 0.08)
"""Times over which noise is averaged, where that of a position may last: a filter's, or a supply's."""
KINK_MM_S = 0.3
UNKNOWN_DRIVE = 30.0
SMALLEST_NOISE_MM = 2e-4
MOST_PIECES = 100
STEPS_SHOW = 3.0
"""Nats by which steps of the output, or of its converter, or a delay must explain the position better: odds of 20."""
MOST_DELAY_SAMPLES = 3.0
"""A position that is read later than that is late by more than converters are."""
SERVO_SAMPLES = 8
"""Fewest samples on either side of a kink: a recording with less in NEAR_KINK_S is too slow to show a servo."""
LED_IN = 200
"""Samples of a steady ramp before a stretch, in which a servo's answer settles."""


@dataclass(frozen=True, slots=True)
class Motion(ArmPath):
    """The arm's motion at full rate, each (N,) but where told, and what the nominal servo leaves of the recording.

    ``servo_residual_mm`` is recorded minus the nominal servo's answer to the command and ``servo_signature_mm`` (N, 2)
    how the answer of the servo that was found changes with ln(natural frequency) and ln(damping ratio); zero where no
    command was recorded.
    ``shake_mm_s2`` (N, 2) is by how much more the arm accelerates at the samples than between them if the output steps
    and so pushes it once a sample: just before it steps, and just after.
    ``kinks`` are the samples at which the velocity of the command changes at once.
    ``if_noise_lasts`` is where the arm was if what wanders beside a servo's answer is the sensor's, however slow; None
    where that is no more than over 5 ms, or no servo is known.
    """

    shake_mm_s2: FloatArray
    servo_residual_mm: FloatArray
    servo_signature_mm: FloatArray
    kinks: IntArray
    if_noise_lasts: ArmPath | None = None


@dataclass(frozen=True, slots=True)
class FoundServo:
    """Natural frequency (rad/s) and damping ratio of the servo that explains recorded position best.

    ``of_lines`` is driven by lines from sample to sample, ``of_steps`` by a command that stands from one to the next,
    as a card plays it; ``steps_show`` tells whether recordings say that it does. ``of_late`` is driven by lines, and
    read ``late_s`` later, where they say that it is; else that is 0. ``rounding_shows`` tells whether they say that the
    arm follows the converter's steps of the recorded command; else the recorder's converter made them.
    """

    of_lines: tuple[float, float] = (DEFAULT_NATURAL_FREQUENCY_RAD_S, DEFAULT_DAMPING_RATIO)
    of_steps: tuple[float, float] = (DEFAULT_NATURAL_FREQUENCY_RAD_S, DEFAULT_DAMPING_RATIO)
    steps_show: bool = False
    rounding_shows: bool = False
    of_late: tuple[float, float] = (DEFAULT_NATURAL_FREQUENCY_RAD_S, DEFAULT_DAMPING_RATIO)
    late_s: float = 0.0


NOMINAL_SERVO = FoundServo()


def find_kinks(trial: Trial) -> IntArray:
    """Return the samples (K,) at which the motion starts, stops or changes speed.

    Phase boundaries count; beside them a change of velocity by more than 0.3 mm/s within 2 ms does, so
    that a command that was never cut into phases is handled too.
    """
    path_mm = trial.command_mm if trial.command_mm is not None else trial.position_mm
    n = len(path_mm)
    w = max(1, round(VELOCITY_WINDOW_S * trial.sample_rate_hz))
    found = {0}
    for p in trial.phases:
        found.update((p.start, min(p.stop, n - 1)))
    if n > 4 * w and trial.kind != "air_sweep":
        if trial.command_mm is None:
            path_mm = gaussian_filter1d(path_mm, w)
        velocity = (path_mm[w:] - path_mm[:-w]) * trial.sample_rate_hz / w
        change = np.abs(velocity[w:] - velocity[:-w])
        above = np.flatnonzero(change > KINK_MM_S)
        if above.size:
            groups = np.split(above, np.flatnonzero(np.diff(above) > w) + 1)
            if len(groups) <= 40:  # a path that is all kinks has none worth the name
                found.update(int(g[np.argmax(change[g])]) + w for g in groups)
    return np.array(sorted(found), dtype=np.int64)


def fit_servo(trials: list[Trial]) -> FoundServo:
    """Return the servo that explains recorded position best.

    Of a press only samples near kinks carry information on the servo, of a sweep all do. Without a command, where
    nothing moves, or where samples are too far apart to show a servo, the nominal one is returned.
    """
    pieces = []
    for trial in trials:
        command_mm = trial.command_mm
        if command_mm is None:
            continue
        half = round(NEAR_KINK_S * trial.sample_rate_hz)
        if half < SERVO_SAMPLES:
            continue
        stretches, kinks = [(0, trial.n_samples)], find_kinks(trial)
        if trial.kind != "air_sweep":
            stretches = [(max(0, k - half), min(trial.n_samples, k + half)) for k in kinks]
        straight_mm = straightened(command_mm, kinks.tolist())
        for lo, hi in stretches:
            u = command_mm[lo:hi]
            # a stretch must begin at rest or on a steady ramp, or the filter's start would be wrong
            if hi - lo < half or np.ptp(u) < 0.01:
                continue
            commands = tuple(map(_led_in, (u, straight_mm[lo:hi])))
            pieces.append((commands, trial.position_mm[lo:hi], trial.sample_rate_hz))
    if not pieces:
        return NOMINAL_SERVO
    slowest_hz = min(rate for *_, rate in pieces)
    pieces = pieces[:MOST_PIECES]

    def residual(p: FloatArray, held: bool, straight: bool = False) -> FloatArray:
        wn, zeta, late_s = np.exp(p[0]), np.exp(p[1]), p[2] / slowest_hz if len(p) > 2 else 0.0
        out = []
        for commands, x, rate in pieces:
            command, level_and_gain = commands[int(straight)]
            model = follow(command, rate, wn, zeta, held=held).position_mm
            r = x - later(model, late_s * rate)[LED_IN:]
            out.append(r - level_and_gain @ (level_and_gain.T @ r))
        return np.concatenate(out) * 1e3

    start = np.log([DEFAULT_NATURAL_FREQUENCY_RAD_S, DEFAULT_DAMPING_RATIO])
    lower, upper = np.log([10.0, 0.1]), np.log([5.0e4, 5.0])
    lines, steps = (
        least_squares(
            residual, start, bounds=(lower, upper), diff_step=[1e-3] * 2, max_nfev=15, kwargs={"held": held}
        )
        for held in (False, True)
    )
    late = least_squares(
        residual,
        np.append(start, 1.0),
        bounds=(np.append(lower, 0.0), np.append(upper, MOST_DELAY_SAMPLES)),
        diff_step=[1e-3] * 3,
        max_nfev=15,
        kwargs={"held": False},
    )

    def likelier(cost: float, other: float) -> bool:
        return bool(0.5 * len(lines.fun) * np.log(max(other, 1e-300) / max(cost, 1e-300)) > STEPS_SHOW)

    of_lines, of_steps, of_late = (
        (float(np.exp(best.x[0])), float(np.exp(best.x[1]))) for best in (lines, steps, late)
    )
    held = likelier(steps.cost, lines.cost)
    best = steps if held else lines
    late_s = 0.0
    if likelier(late.cost, best.cost):
        held, best, late_s = False, late, float(late.x[2]) / slowest_hz
    straight = 0.5 * float(np.sum(residual(best.x, held, straight=True) ** 2))
    return FoundServo(of_lines, of_steps, held, likelier(best.cost, straight), of_late, late_s)


def _led_in(command_mm: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a stretch of command (N,) with a steady ramp before it, and a basis (N, 2) of what calibrations change."""
    lead = np.polynomial.polynomial.polyfit(np.arange(float(SERVO_SAMPLES)), command_mm[:SERVO_SAMPLES], 1)
    ramp_in = lead[0] + lead[1] * np.arange(-float(LED_IN), 0.0)
    basis = np.column_stack([np.ones_like(command_mm), command_mm - command_mm.mean()])
    return np.concatenate([ramp_in, command_mm]), np.linalg.qr(basis)[0]


def later(signal: FloatArray, samples: float, *, smooth: bool = True) -> FloatArray:
    """Return a signal (N,) so many samples later: along a cubic spline if it is smooth, else along lines."""
    return np.asarray(shift(signal, samples, order=3 if smooth else 1, mode="nearest")) if samples else signal


def _servo_explains(recorded_mm: FloatArray, noise_mm: float, servo_mm: FloatArray) -> bool:
    """Whether a servo's answer explains recorded position but for calibration, to some times its noise."""
    x = servo_mm - servo_mm.mean()
    gain = float(x @ recorded_mm) / max(float(x @ x), 1e-30)
    left = recorded_mm - recorded_mm.mean() - gain * x
    return bool(float(np.std(left)) <= UNKNOWN_DRIVE * max(noise_mm, SMALLEST_NOISE_MM))


def estimate_motion(trial: Trial, servo: FoundServo = NOMINAL_SERVO) -> Motion:
    """Return the motion behind a recording: the servo's answer plus the smoothed rest.

    The rest is smoothed over 0.8 ms near kinks, where it may be fast, and over 5 ms elsewhere, or in both as much more
    as it bears: what stays of its noise would be a force in contact, which a dashpot and a delay together smooth away.
    Without a command the recorded position itself is smoothed, where it turns over no more than it bears: over 0.8 ms a
    ramp of 9 mm/s begins and ends 2 um too gently, which is half a millinewton.
    """
    rate, recorded = trial.sample_rate_hz, trial.position_mm
    kinks, shake = find_kinks(trial), np.zeros((len(recorded), 2))
    if trial.command_mm is not None:
        lines = trial.command_mm
        if not servo.rounding_shows:
            lines = straightened(lines, kinks.tolist())
        stepped = follow(lines, rate, *servo.of_steps, held=True)
        if servo.steps_show:
            base, v = stepped.position_mm, stepped.velocity_mm_s
            a = np.diff(v, prepend=0.0) * rate
        else:
            driven = follow(lines, rate, *(servo.of_late if servo.late_s else servo.of_lines))
            samples = servo.late_s * rate
            base = later(driven.position_mm, samples)
            v = later(driven.velocity_mm_s, samples, smooth=False)
            a = later(driven.acceleration_mm_s2, samples, smooth=False)
        before = stepped.acceleration_mm_s2 - a
        shake = np.column_stack([before, before + servo.of_steps[0] ** 2 * np.diff(lines, prepend=lines[0])])
    else:
        base, v, a = np.zeros_like(recorded), np.zeros_like(recorded), np.zeros_like(recorded)
    # what a servo's answer leaves of a recording has none of its converter's levels any more
    noise_mm, near = position_noise(recorded), near_kinks(kinks, len(recorded), rate)
    if_noise_lasts = None
    if trial.command_mm is None:
        path = without_command(recorded, noise_mm, near, rate)
    elif _servo_explains(recorded, noise_mm, base):
        rest = recorded - base
        averaged = [max(noise_mm, averaged_noise(rest, max(1, round(s * rate)))) for s in LASTING_S]
        path = beside_servo(rest, averaged[0], near, rate).beside(base, v, a)
        if max(averaged) > averaged[0]:
            if_noise_lasts = beside_servo(rest, max(averaged), near, rate).beside(base, v, a)
    else:
        # a drive that is no such servo: its answer would add accelerations that never were
        shake = np.zeros_like(shake)
        path = of_unknown_drive(recorded, noise_mm, rate)
    servo_residual, signature = np.zeros_like(recorded), np.zeros((len(recorded), 2))
    if trial.command_mm is not None:
        wn, zeta = DEFAULT_NATURAL_FREQUENCY_RAD_S, DEFAULT_DAMPING_RATIO
        nominal = follow(trial.command_mm, rate, wn, zeta).position_mm
        servo_residual = recorded - nominal
        # at the servo that was found: far from the nominal one both parameters say the same there
        h, (wn, zeta) = 1e-3, servo.of_lines
        found = follow(trial.command_mm, rate, wn, zeta).position_mm
        signature[:, 0] = (follow(trial.command_mm, rate, wn * (1 + h), zeta).position_mm - found) / h
        signature[:, 1] = (follow(trial.command_mm, rate, wn, zeta * (1 + h)).position_mm - found) / h
    return Motion(
        position_mm=path.position_mm,
        velocity_mm_s=path.velocity_mm_s,
        acceleration_mm_s2=path.acceleration_mm_s2,
        position_error_mm=path.position_error_mm,
        noise_mm=path.noise_mm,
        beside_servo_mm=path.beside_servo_mm,
        shake_mm_s2=shake,
        servo_residual_mm=servo_residual,
        servo_signature_mm=signature,
        kinks=kinks,
        if_noise_lasts=if_noise_lasts,
    )
