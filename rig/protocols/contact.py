"""When contact begins and when it is lost, judged from the samples alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.recordings.trial import FloatArray

_TRAIL_SAMPLES = 480
"""How far back the rise to the threshold is looked at: at 1 mm/s on skin, 5 to 10 mN take some 40 ms."""

_LOOSE_AT_LEAST_MM = 0.4
"""Travel above the detected surface before contact can count as lost: the skin clings and bulges."""

_LEFT_SHARE = 0.1
_LEFT_READS = 2
"""A finger has left when the mean of so many reads in a row is below that share of the contact's threshold."""

_FLAT_MN = 1.5
"""In the free arm, the mean force of two successive reads differs by less."""


class ContactDetector:
    """Watches a stream of force samples: contact is `samples_above` of the last `samples_watched`."""

    def __init__(self, threshold: float, samples_above: int, samples_watched: int) -> None:
        self.threshold = threshold
        self._needed = samples_above
        self._watched = samples_watched
        self._recent = np.zeros(0, dtype=np.int64)
        self._seen = 0

    def feed(self, force: FloatArray) -> int | None:
        """Look at the next samples, (n,), in the threshold's unit; return the sample that decided, or None.

        Samples are counted over all calls, from 0.
        """
        above = np.concatenate([self._recent, (force > self.threshold).astype(np.int64)])
        sums = np.cumsum(above)
        sums[self._watched :] -= sums[: -self._watched].copy()
        decided = np.flatnonzero(sums[len(self._recent) :] >= self._needed)
        first = self._seen
        self._seen += len(force)
        self._recent = above[max(0, len(above) - self._watched + 1) :]
        return first + int(decided[0]) if decided.size else None


@dataclass(frozen=True, slots=True)
class Crossing:
    """Where the force rose through a threshold: the sample (fractions too) and the position there."""

    sample: float
    position: float


def locate_crossing(position: FloatArray, force: FloatArray, threshold: float) -> Crossing:
    """Say where `force` rose through `threshold`, below the noise of a sample.

    `position` and `force` are (n,), any units, up to the sample that decided on contact; force counts from
    that of the free arm. Straight lines through the rise from half the threshold on, over time; where the
    rise is too short for a line, the last sample stands.
    """
    n = len(force)
    start = max(0, n - _TRAIL_SAMPLES)
    below = np.flatnonzero(force[start:] < 0.5 * threshold)
    start += int(below[-1]) + 1 if below.size else 0
    time = np.arange(start, n, dtype=np.float64)
    if len(time) < 4:
        return Crossing(float(n - 1), float(position[-1]))
    middle = time.mean()
    rise, level = np.polyfit(time - middle, force[start:], 1)
    speed, place = np.polyfit(time - middle, position[start:], 1)
    crossed = middle + (threshold - level) / rise if rise > 0 else time[-1]
    crossed = float(np.clip(crossed, time[0], time[-1]))
    return Crossing(crossed, float(place + speed * (crossed - middle)))


class LeavingDetector:
    """Watches a hold: the finger has left when the force is back at that of the free arm for a while.

    Skin that is pressed relaxes to some 60 % of the force of the first touch, never to none of it.
    """

    def __init__(self, free_mn: float, threshold_mn: float) -> None:
        self._least_mn = free_mn + _LEFT_SHARE * threshold_mn
        self._reads = 0

    def feed(self, force_mn: FloatArray) -> bool:
        """Look at the next samples, (n,); return True once the finger has left."""
        self._reads = self._reads + 1 if float(np.mean(force_mn)) < self._least_mn else 0
        return self._reads >= _LEFT_READS


class ReleaseDetector:
    """Watches a retract: contact is lost when the force is back at that of the free arm, and flat.

    The force may be below zero while the skin clings, so force alone is no sign: the arm must also be clear
    of the surface by a margin. `tolerance_mn` is how far the free arm's force may have moved meanwhile
    (friction of the moving arm, drift).
    """

    def __init__(self, free_mn: float, surface_mm: float, tolerance_mn: float) -> None:
        self._free_mn = free_mn
        self._clear_mm = surface_mm - _LOOSE_AT_LEAST_MM
        self._tolerance_mn = tolerance_mn
        self._last_mn: float | None = None

    def feed(self, position_mm: FloatArray, force_mn: FloatArray) -> bool:
        """Look at the next samples, both (n,); return True once contact is lost."""
        mean_mn = float(np.mean(force_mn))
        flat = self._last_mn is not None and abs(mean_mn - self._last_mn) < _FLAT_MN
        self._last_mn = mean_mn
        back = abs(mean_mn - self._free_mn) < self._tolerance_mn
        return flat and back and float(np.mean(position_mm)) < self._clear_mm
