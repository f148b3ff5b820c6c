"""The phases of a trial found from the lever's motion alone, for recordings that do not name them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from analysis.recordings.trial import FloatArray, Phase

SMEAR_S = 0.004
"""Speed is taken over twice this time, which smears the ends of a move."""

_MOVING = 0.03  # share of the largest speed that counts as moving; a hold that creeps stays below it
_SAME_LEVEL = 0.02  # share of the travel within which two rests are at the same height
_ARRIVED = 0.005  # share of a move within which it has arrived
_NOISE_FACTOR = 6.0


@dataclass(frozen=True, slots=True)
class Stretch:
    """Samples during which the lever moves one way (sign +1, -1) or rests (0)."""

    start: int
    stop: int
    sign: int


def phases_from_motion(position_mm: FloatArray, sample_rate_hz: float) -> tuple[Phase, ...]:
    """Return the phases of a press, hold and release, or none where the motion shows no hold.

    position_mm (N,), positive into the skin. The hold is the longest rest at the deepest level, the ramp
    the push that ends there; what comes before is dwell (a rest that another push led to) and approach,
    what comes after is retract and clear.
    """
    noise = position_noise(position_mm)
    stretches = moves_and_rests(position_mm, sample_rate_hz)
    hold = _hold(position_mm, stretches)
    if hold is None:
        return ()
    before = stretches[:hold]
    after = stretches[hold + 1 :]
    ramp = before[-1]
    ramp_start, ramp_stop = _sharpened(position_mm, ramp, stretches[hold], noise)
    phases = [*_before_ramp(before[:-1], ramp_start), Phase("ramp", ramp_start, ramp_stop)]
    moves = [stretch for stretch in after if stretch.sign]
    if not moves:
        return (*phases, Phase("hold", ramp_stop, len(position_mm)))
    retract_start, _ = _sharpened(position_mm, moves[0], None, noise)
    retract_stop = moves[-1].stop
    phases += [Phase("hold", ramp_stop, retract_start), Phase("retract", retract_start, retract_stop)]
    if retract_stop < len(position_mm):
        phases.append(Phase("clear", retract_stop, len(position_mm)))
    return tuple(phase for phase in phases if phase.stop > phase.start)


def position_noise(position_mm: FloatArray) -> float:
    """Return the noise of a sample, mm, from second differences, in which a smooth motion cancels."""
    if len(position_mm) < 4:
        return 0.0
    # the second difference of white noise has a standard deviation of sqrt(6) times its own
    return float(np.median(np.abs(np.diff(position_mm, 2))) / 0.6745 / np.sqrt(6))


def moves_and_rests(position_mm: FloatArray, sample_rate_hz: float) -> list[Stretch]:
    """Split the motion (N,), mm, into moves and rests; small wiggles count as rest.

    Ends are true to within SMEAR_S. Empty where nothing moves.
    """
    n, rate, noise = len(position_mm), sample_rate_hz, position_noise(position_mm)
    travel = float(np.ptp(position_mm)) if n else 0.0
    if n < 8 or travel <= 20 * noise:
        return []
    lag = max(1, min(round(SMEAR_S * rate), n // 200))
    speed = np.zeros(n)
    speed[lag:-lag] = (position_mm[2 * lag :] - position_mm[: -2 * lag]) * rate / (2 * lag)
    speed[:lag], speed[-lag:] = speed[lag], speed[-lag - 1]
    fastest = float(np.abs(speed).max())
    threshold = max(_MOVING * fastest, _NOISE_FACTOR * noise * rate / (np.sqrt(2) * lag))
    sign = np.where(np.abs(speed) > threshold, np.sign(speed), 0).astype(int)
    edges = np.flatnonzero(np.diff(sign)) + 1
    bounds = [0, *edges.tolist(), n]
    raw = [Stretch(a, b, int(sign[a])) for a, b in pairwise(bounds)]
    smallest = max(_SAME_LEVEL * travel, _NOISE_FACTOR * noise)
    return _without_turns(_merged(raw, position_mm, smallest, 2 * lag), 6 * lag)


def _without_turns(stretches: list[Stretch], shortest: int) -> list[Stretch]:
    """Leave away rests so short that they are only the moment in which a move turns round."""
    return [
        stretch
        for i, stretch in enumerate(stretches)
        if stretch.sign or i in {0, len(stretches) - 1} or stretch.stop - stretch.start > shortest
    ]


def _merged(raw: list[Stretch], position_mm: FloatArray, smallest_mm: float, gap: int) -> list[Stretch]:
    """Join moves the same way across short rests, turn negligible moves into rest, join neighbours."""
    n = len(position_mm)

    def displacement(stretch: Stretch) -> float:
        return abs(float(position_mm[min(stretch.stop, n - 1)] - position_mm[stretch.start]))

    joined: list[Stretch] = []
    for stretch in raw:
        short_rest = len(joined) >= 2 and joined[-1].sign == 0 and joined[-1].stop - joined[-1].start <= gap
        if short_rest and stretch.sign and joined[-2].sign == stretch.sign:
            joined[-2:] = [Stretch(joined[-2].start, stretch.stop, stretch.sign)]
        else:
            joined.append(stretch)
    result: list[Stretch] = []
    for stretch in joined:
        sign = stretch.sign if displacement(stretch) >= smallest_mm else 0
        if result and result[-1].sign == sign:
            result[-1] = Stretch(result[-1].start, stretch.stop, sign)
        else:
            result.append(Stretch(stretch.start, stretch.stop, sign))
    return result


def _hold(position_mm: FloatArray, stretches: list[Stretch]) -> int | None:
    """Return the index of the longest rest at the deepest level that a push leads to."""
    rests = [i for i, s in enumerate(stretches) if s.sign == 0 and i > 0 and stretches[i - 1].sign > 0]
    if not rests:
        return None
    level = {i: float(np.median(position_mm[stretches[i].start : stretches[i].stop])) for i in rests}
    deepest = max(level.values()) - _SAME_LEVEL * float(np.ptp(position_mm))
    return max(
        (i for i in rests if level[i] >= deepest), key=lambda i: stretches[i].stop - stretches[i].start
    )


def _sharpened(position_mm: FloatArray, move: Stretch, rest: Stretch | None, noise: float) -> tuple[int, int]:
    """Trim a move, whose ends the speed's lag has smeared, to where it leaves and where it arrives."""
    x = position_mm[move.start : move.stop]
    tolerance = max(_ARRIVED * float(np.ptp(x)), 4 * noise)
    left = np.flatnonzero(np.abs(x - x[0]) > tolerance)
    start = move.start + (max(0, int(left[0]) - 1) if left.size else 0)
    if rest is None:
        return start, move.stop
    level = float(np.median(position_mm[rest.start : rest.start + max(1, move.stop - move.start)]))
    away = np.flatnonzero(np.abs(x - level) > tolerance)
    stop = move.start + (int(away[-1]) + 1 if away.size else len(x))
    return start, max(stop, start + 1)


def _before_ramp(before: list[Stretch], ramp_start: int) -> list[Phase]:
    if not before:
        return [Phase("approach", 0, ramp_start)] if ramp_start else []
    if len(before) >= 2 and before[-1].sign == 0 and before[-2].sign > 0:
        rest = before[-1].start
        return [Phase("approach", 0, rest), Phase("dwell", rest, ramp_start)]
    return [Phase("approach", 0, ramp_start)]
