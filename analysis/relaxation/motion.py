"""What the lever really did, as straight pieces between knots: the recorded motion without its noise.

The recorded position has noise of its own (0.2 to 0.3 um a sample); a tissue model driven by it is biased.
What is known goes first: the command through the servo. What the recording says beyond that is fitted to it
as straight pieces. Without a command, the pieces are fitted to the recorded position itself.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import FloatArray
from analysis.relaxation.response import arm_response_and_slope
from analysis.relaxation.windows import FitWindow

NATURAL_FREQUENCY_RAD_S = 5.0e3  # of the lever's servo, critically damped

IntArray = NDArray[np.int64]

_CURVED_SPAN = 64  # samples over which the motion is asked whether it is straight
_CURVED_UM_OF_COMMAND = 0.05
_CURVED_SIGMAS = 6.0


def servo_answer(command_mm: FloatArray, step_s: float) -> FloatArray:
    """Return the position (N,) mm of a critically damped servo that starts at rest on the first command.

    With tau = 1 / wn and Q = tau s / (1 + tau s), what an arm of time tau makes of a motion, the servo is
    1 / (1 + tau s)^2 = 1 - Q - tau dQ/dtau: exact for a command that is linear between samples.
    """
    tau_s = 1.0 / NATURAL_FREQUENCY_RAD_S
    stretch_mm, slope = arm_response_and_slope(command_mm, step_s, tau_s)
    return command_mm - stretch_mm - tau_s * slope


def known_motion(window: FitWindow) -> FloatArray | None:
    """Return the motion (N,) mm that the command explains, or None without a usable command."""
    command_mm = window.command_mm
    if command_mm is None or not window.even:
        return None
    answer_mm = servo_answer(command_mm, window.step_s)
    travel_mm = np.ptp(window.position_mm)
    missed_mm = window.position_mm - answer_mm
    # a command that does not move the lever (a channel left unwired) explains nothing
    return answer_mm if np.ptp(missed_mm) < 0.5 * travel_mm else None


def curved_stretches(motion_mm: FloatArray, *, noisy: bool) -> IntArray:
    """Return (M, 2) starts and stops of the stretches in which the motion is not straight.

    Asked over 64 samples, twice, half a stretch apart: do the outer quarters lie off the middle half?
    ``noisy`` sets the limit by the motion's own noise; a motion from the command has a fixed one, 0.05 um.
    """
    limit_mm = 1e-3 * _CURVED_UM_OF_COMMAND
    if noisy:
        bends = np.abs(np.diff(motion_mm, 2))
        sigma_mm = np.median(bends) / 0.6745 / np.sqrt(6.0) if bends.size else 0.0
        limit_mm = max(limit_mm, _CURVED_SIGMAS * sigma_mm * 4.0 / np.sqrt(_CURVED_SPAN))
    found: list[tuple[int, int]] = []
    quarter = _CURVED_SPAN // 4
    for shift in (0, _CURVED_SPAN // 2):
        rows = (len(motion_mm) - shift) // _CURVED_SPAN
        if rows < 1:
            continue
        parts = motion_mm[shift : shift + rows * _CURVED_SPAN].reshape(rows, 4, quarter).mean(axis=2)
        bend_mm = np.abs(parts[:, 0] + parts[:, 3] - parts[:, 1] - parts[:, 2])
        for row in np.flatnonzero(bend_mm > limit_mm):
            start = shift + int(row) * _CURVED_SPAN
            found.append((start, start + _CURVED_SPAN))
    return _merged(sorted(found))


def _merged(stretches: list[tuple[int, int]]) -> IntArray:
    merged: list[list[int]] = []
    for start, stop in stretches:
        if merged and start <= merged[-1][1]:
            merged[-1][1] = max(merged[-1][1], stop)
        else:
            merged.append([start, stop])
    return np.array(merged, dtype=np.int64).reshape(-1, 2)


def straight_pieces(values: FloatArray, knots: IntArray) -> FloatArray:
    """Return the values (K,) at the knots of the continuous straight pieces nearest to samples (N,).

    Least squares over hat functions; ``knots`` (K,) are sample indices, rising, from 0 to N - 1.
    """
    from scipy.linalg import solveh_banded

    lengths = np.diff(knots)
    local = np.arange(knots[-1]) - np.repeat(knots[:-1], lengths)
    share = local / np.repeat(lengths, lengths)
    inner = values[: knots[-1]]
    total = np.add.reduceat(inner, knots[:-1])
    upper = np.add.reduceat(inner * share, knots[:-1])
    # sums over 0..n-1 of (j/n), (j/n)^2
    n = lengths.astype(float)
    first = (n - 1) / 2
    second = (n - 1) * (2 * n - 1) / (6 * n)
    diagonal = np.zeros(len(knots))
    diagonal[:-1] += n - 2 * first + second
    diagonal[1:] += second
    diagonal[-1] += 1.0
    right = np.zeros(len(knots))
    right[:-1] += total - upper
    right[1:] += upper
    right[-1] += values[knots[-1]]
    band = np.zeros((2, len(knots)))
    band[0, 1:] = first - second
    band[1] = diagonal
    return np.asarray(solveh_banded(band, right, check_finite=False), dtype=float)
