"""Where in the recording a command began: exact by loop-back, else where it is expected."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_DEPARTURE_V = 0.004
"""A loop-back that far from its rest has begun to move: 13 steps of a 16-bit converter over +-10 V."""

_AT_REST_V = 0.002
"""Samples that lie so close together are of an output at rest."""

_CERTAINTY = 120.0
"""A shift is taken when its rival, one sample off, fits worse by so many noise variances (5 sigma)."""

_SMALLEST_NOISE_V = 5e-5
"""Even a noiseless loop-back is rounded to 0.3 mV: no residual is believed to be smaller."""

_REACH = 8
"""Shifts tried on either side of the first guess, samples."""

_PATIENCE = 1.3
"""An unsuccessful search is repeated when there are so many times the samples since the earliest start."""

_HISTORY = 4096
"""Samples before the start that are used to know the rest it starts from."""


class CommandTrack:
    """The command in volts over the samples of a recording: what was sent, and what is held after it.

    One thread writes, others may read: what they read is replaced as a whole.
    """

    def __init__(self, rest_v: float) -> None:
        self._state: tuple[float, int, FloatArray] = (rest_v, 0, np.array([rest_v]))
        self._going_on: FloatArray = np.empty(0)

    @property
    def last_v(self) -> float:
        """The voltage that is held after all that was sent."""
        return float(self._state[2][-1])

    def add(self, start: int, volts: FloatArray) -> None:
        """A waveform begins at sample ``start``; before it, the end of the previous one was held."""
        self._state = (self.last_v, start, volts)

    def begin(self, start: int, volts: FloatArray, n: int) -> None:
        """A waveform begins at sample ``start``, of which only the first ``n`` samples are sent so far."""
        self._going_on = volts
        self.add(start, volts[:n])

    def go_on(self, n: int) -> None:
        """Of the waveform that was begun, ``n`` samples are sent by now."""
        rest_v, start, _ = self._state
        self._state = (rest_v, start, self._going_on[:n])

    def cut(self, n: int, held_v: float) -> None:
        """The last waveform was stopped after ``n`` samples; from then on ``held_v`` is held."""
        rest_v, start, volts = self._state
        self._state = (rest_v, start, np.append(volts[:n], held_v))

    def volts(self, start: int, stop: int) -> FloatArray:
        """The command at samples ``start`` to ``stop`` (exclusive), V."""
        rest_v, begin, volts = self._state
        return _played(volts, rest_v, np.arange(start, stop) - begin)


class StartFinder:
    """Finds the sample at which a waveform began, from the loop-back of the output.

    ``volts``: the waveform (n,), V; ``held_v``: what the output held before; ``not_before``: the sample
    the start can't precede; ``step_v``: the output's converter goes in multiples of it. `feed` takes the
    loop-back, sample by sample in order.

    A waveform that moves by less than a step a sample (1.2 mm/s on a 16-bit card of +-10 V) is found to
    the sample only because the steps are known; on a card whose steps lie elsewhere it may be one off.
    """

    def __init__(self, volts: FloatArray, held_v: float, not_before: int, step_v: float) -> None:
        self.started_sample: int | None = None
        self._volts = np.round(volts / step_v) * step_v
        self._held_v = round(held_v / step_v) * step_v
        self._not_before = not_before
        self._end: int | None = None
        self._data: FloatArray = np.empty(0)
        self._begin = 0
        self._next_search = 0
        sent = np.abs(volts - held_v) > _DEPARTURE_V
        self._sent_departs = int(np.argmax(sent)) if sent.any() else None

    def end_at(self, sample: int) -> None:
        """From this sample on the output did something else."""
        self._end = sample if self._end is None else min(self._end, sample)

    @property
    def searching(self) -> bool:
        """Whether more samples can help."""
        if self.started_sample is not None or self._sent_departs is None:
            return False
        return self._end is None or self._begin + len(self._data) < self._end

    def feed(self, start: int, loopback_v: FloatArray) -> None:
        """Take the next samples, the first of them number ``start``."""
        if not self.searching:
            return
        if self._end is not None:
            loopback_v = loopback_v[: max(self._end - start, 0)]
        if not len(self._data):
            self._begin = start
        self._data = np.concatenate([self._data, loopback_v])
        excess = self._not_before - _HISTORY - self._begin
        if excess > 0:
            self._data, self._begin = self._data[excess:], self._begin + min(excess, len(self._data))
        come = start + len(loopback_v)
        if come >= self._next_search or come == self._end:
            # not of all samples: a long rest before the start would put off the search beyond a short ramp
            self._next_search = self._not_before + int(_PATIENCE * max(come - self._not_before, 0))
            self._search()

    def _search(self) -> None:
        data, before = self._at_rest_before_start()
        if before >= len(data) or self._sent_departs is None:
            return
        base_v = data[:before].mean() if before else data[0]
        came = np.abs(data[before:] - base_v) > _DEPARTURE_V
        if not came.any():
            return
        first = self._begin + len(self._data) - len(data)
        guess = first + before + int(np.argmax(came)) - self._sent_departs
        samples = first + np.arange(len(data))
        while True:
            low, high = max(guess - _REACH, self._not_before), max(guess + _REACH, self._not_before)
            shifts = np.arange(low, high + 1)
            # free in the offset between output and loop-back: the variance, not the mean square
            misfit = np.array(
                [len(data) * np.var(data - _played(self._volts, self._held_v, samples - s)) for s in shifts]
            )
            best = int(np.argmin(misfit))
            # far from the guess, a better one may lie beyond what was tried
            if abs(int(shifts[best]) - guess) <= _REACH // 2:
                break
            guess = int(shifts[best])
        noise_v2 = max(misfit[best] / len(data), _SMALLEST_NOISE_V**2)
        if np.min(np.delete(misfit, best), initial=np.inf) - misfit[best] > _CERTAINTY * noise_v2:
            self.started_sample = int(shifts[best])

    def _at_rest_before_start(self) -> tuple[FloatArray, int]:
        """The samples from the last rest before the start on, and how many lie before the start."""
        before = min(max(self._not_before - self._begin, 0), len(self._data))
        if not before:
            return self._data, 0
        moving = np.abs(self._data[:before] - self._data[before - 1]) > _AT_REST_V
        rest = int(before - np.argmax(moving[::-1])) if moving.any() else 0
        return self._data[rest:], before - rest


def _played(volts: FloatArray, held_v: float, indices: NDArray[np.int64]) -> FloatArray:
    """A waveform at indices counted from its start: held before it, and its last value after it."""
    return np.where(indices < 0, held_v, volts[np.clip(indices, 0, len(volts) - 1)])
