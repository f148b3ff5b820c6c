"""What the lever really did, as straight pieces between knots: the recorded motion without its noise.

The recorded position has noise of its own (0.2 to 0.3 um a sample); a tissue model driven by it is biased.
Where the motion is straight, pieces fitted to many samples take the noise away. Where it bends, the command
through the servo says how, and the recording only where the lever stood; without a command, short pieces are
fitted there too.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import FloatArray
from analysis.relaxation.response import arm_response_and_slope
from analysis.relaxation.windows import FitWindow

NATURAL_FREQUENCY_RAD_S = 5.0e3  # of the lever's servo, critically damped

IntArray = NDArray[np.int64]

_COMMAND_SPAN, _RECORDED_SPAN = 32, 64  # samples over which a motion is asked whether it is straight
_LEAST_BEND_MM = 5e-5
_BEND_SIGMAS = 6.0
_LEAST_CORNER = 1e-3  # of the travel, by which a corner stands off the chord between its samples
_STRAIGHT = 0.1  # of that, by which the samples beside may stand off the lines that meet in it
_SETTLING_S = 0.004  # of the servo after its command was straight again


def servo_answer(command_mm: FloatArray, step_s: float) -> FloatArray:
    """Return the position (N,) mm of a critically damped servo that starts at rest on the first command.

    With tau = 1 / wn and Q = tau s / (1 + tau s), what an arm of time tau makes of a motion, the servo is
    1 / (1 + tau s)^2 = 1 - Q - tau dQ/dtau: exact for a command that is linear between samples.
    """
    tau_s = 1.0 / NATURAL_FREQUENCY_RAD_S
    stretch_mm, slope = arm_response_and_slope(command_mm, step_s, tau_s)
    return np.asarray(command_mm - stretch_mm - tau_s * slope, dtype=float)


def usable_command(window: FitWindow) -> FloatArray | None:
    """Return the command (N,) mm if it moves the lever; a channel left unwired explains nothing."""
    command_mm = window.command_mm
    if command_mm is None or not window.even:
        return None
    stride = max(1, len(command_mm) // 2000)
    recorded_mm = window.position_mm[::stride]
    missed_mm = recorded_mm - command_mm[::stride]
    return command_mm if np.ptp(missed_mm) < 0.5 * np.ptp(recorded_mm) else None


def curved_stretches(window: FitWindow) -> IntArray:
    """Return (M, 2) starts and stops, in samples, of the stretches in which the motion is not straight."""
    command_mm = usable_command(window)
    if command_mm is None:
        return _bends(window.position_mm, _RECORDED_SPAN, 0)
    return _bends(command_mm, _COMMAND_SPAN, round(_SETTLING_S / window.step_s))


def _bends(motion_mm: FloatArray, span: int, settling: int) -> IntArray:
    """Ask over ``span`` samples, twice, half a span apart: do the outer quarters lie off the middle half?"""
    n = len(motion_mm)
    sigma_mm = sample_noise(motion_mm)
    limit_mm = max(_LEAST_BEND_MM, _BEND_SIGMAS * sigma_mm * 4.0 / float(np.sqrt(span)))
    quarter = span // 4
    quarters = np.add.reduceat(
        motion_mm[: n // quarter * quarter], np.arange(0, n // quarter * quarter, quarter)
    )
    quarters /= quarter
    bend_mm = np.abs(quarters[:-3] - quarters[1:-2] - quarters[2:-1] + quarters[3:])
    starts = np.flatnonzero(bend_mm > limit_mm) * quarter
    if not starts.size:
        return np.empty((0, 2), dtype=np.int64)
    stops = np.minimum(starts + span + settling, n)
    first = np.append(True, starts[1:] > stops[:-1])
    last = np.append(first[1:], True)
    return np.stack([starts[first], stops[last]], axis=1).astype(np.int64)


def sample_noise(values: FloatArray) -> float:
    """Return the standard deviation of what differs from sample to sample, from second differences."""
    if len(values) < 4:
        return 0.0
    stride = max(1, len(values) // 4096)
    stop = (len(values) - 2) // stride * stride
    bends = values[:stop:stride] - 2.0 * values[1 : stop + 1 : stride] + values[2 : stop + 2 : stride]
    return float(np.median(np.abs(bends))) / 0.6745 / float(np.sqrt(6.0)) if bends.size else 0.0


def corners(time_s: FloatArray, position_mm: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the corners of a motion that lie between its samples: interval, instant (s), position (mm), each (J,).

    A corner is where the straight lines of the two samples before and the two after an interval meet in
    it, if the motion is straight on both sides; sampled slowly, a ramp begins and ends at such.
    """
    n = len(time_s)
    nothing = np.empty(0, dtype=np.int64), np.empty(0), np.empty(0)
    if n < 6:
        return nothing
    slope = np.diff(position_mm) / np.diff(time_s)
    at = np.arange(2, n - 3)
    before, after = slope[at - 1], slope[at + 1]
    turn = before - after
    moved_mm = position_mm[at + 1] - position_mm[at]
    meeting = moved_mm + before * time_s[at] - after * time_s[at + 1]
    # where the lines are parallel they meet nowhere: outside of every interval
    instant_s = np.divide(meeting, turn, out=np.full(len(at), -1.0), where=np.abs(turn) > 1e-300)
    instant_s = np.clip(instant_s, time_s[at], time_s[at + 1])
    place_mm = position_mm[at] + before * (instant_s - time_s[at])
    inside = (instant_s > time_s[at]) & (instant_s < time_s[at + 1])
    chord_mm = position_mm[at] + slope[at] * (instant_s - time_s[at])
    bend_mm = np.abs(place_mm - chord_mm)
    # how far the sample two before and two after lie off the lines
    off_mm = np.abs(slope[at - 2] - before) * (time_s[at - 1] - time_s[at - 2])
    off_mm = np.maximum(off_mm, np.abs(slope[at + 2] - after) * (time_s[at + 3] - time_s[at + 2]))
    least_mm = max(_BEND_SIGMAS * sample_noise(position_mm), _LEAST_CORNER * float(np.ptp(position_mm)))
    found = inside & (bend_mm > least_mm) & (off_mm < _STRAIGHT * bend_mm)
    return at[found], instant_s[found], place_mm[found]


def positions_at(window: FitWindow, knots: IntArray, curved: IntArray) -> FloatArray:
    """Return the motion (K,) mm at the knots (K,), sample indices that rise from 0 to N - 1."""
    position_mm = straight_pieces(window.position_mm, knots)
    command_mm = usable_command(window)
    if command_mm is None:
        return position_mm
    for start, stop in curved.tolist():
        inside = (knots >= start) & (knots < stop)
        if not inside.any():
            continue
        # the servo's state at the start of a bend: it follows a straight command 2 / wn behind
        slope = float(command_mm[start] - command_mm[max(0, start - 8)]) / max(1, min(8, start))
        lead = command_mm[start] + slope * np.arange(-64, 0)
        answer_mm = servo_answer(np.concatenate([lead, command_mm[start:stop]]), window.step_s)[64:]
        # the recording says where the lever stood, and by how much command and position differ in gain
        age = np.linspace(-1.0, 1.0, stop - start)
        missed_mm = window.position_mm[start:stop] - answer_mm
        tilt = float(age @ missed_mm) / float(age @ age)
        at = knots[inside] - start
        position_mm[inside] = answer_mm[at] + missed_mm.mean() + tilt * age[at]
    return position_mm


def straight_pieces(values: FloatArray, knots: IntArray) -> FloatArray:
    """Return the values (K,) at the knots of the continuous straight pieces nearest to samples (N,).

    Least squares over hat functions; ``knots`` (K,) are sample indices, rising, from 0 to N - 1.
    """
    from scipy.linalg import solveh_banded

    n = np.diff(knots).astype(float)
    origin = values[0]
    inner = values[: knots[-1]] - origin
    total = np.add.reduceat(inner, knots[:-1])
    inner *= np.arange(knots[-1])
    upper = (np.add.reduceat(inner, knots[:-1]) - knots[:-1] * total) / n
    # sums over 0..n-1 of (j/n), (j/n)^2
    first = (n - 1) / 2
    second = (n - 1) * (2 * n - 1) / (6 * n)
    diagonal = np.zeros(len(knots))
    diagonal[:-1] += n - 2 * first + second
    diagonal[1:] += second
    diagonal[-1] += 1.0
    right = np.zeros(len(knots))
    right[:-1] += total - upper
    right[1:] += upper
    right[-1] += values[knots[-1]] - origin
    band = np.zeros((2, len(knots)))
    band[0, 1:] = first - second
    band[1] = diagonal
    return np.asarray(solveh_banded(band, right, check_finite=False) + origin, dtype=float)
