"""A waveform on its way through the output, and the samples that come back meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import Calibration
from rig.hardware.alignment import StartFinder
from rig.hardware.daq import CardOutput, CardStream

FloatArray = NDArray[np.float64]

_PIECES = 3
"""A stream is topped up as soon as so small a part of its lead is used: each write costs a call to the card."""


@dataclass(frozen=True)
class Chunk:
    """Consecutive samples, in order and without a gap.

    ``start``: index of the first sample since recording began. ``position_v``, ``force_v``,
    ``command_v``: volts, each (n,). ``command_v`` is the loop-back where it is wired, else the sent
    command at its expected place.
    """

    start: int
    position_v: FloatArray
    force_v: FloatArray
    command_v: FloatArray
    calibration: Calibration

    @property
    def n(self) -> int:
        """Number of samples."""
        return len(self.position_v)

    @property
    def stop(self) -> int:
        """Index of the sample after the last."""
        return self.start + self.n

    @property
    def position_mm(self) -> FloatArray:
        """Lever position, (n,), mm, positive into the skin."""
        c = self.calibration
        return (self.position_v - c.position_zero_v) / c.volts_per_mm

    @property
    def force_mn(self) -> FloatArray:
        """Force, (n,), mN, positive in compression."""
        c = self.calibration
        return (self.force_v - c.force_zero_v) / c.volts_per_mn

    @property
    def command_mm(self) -> FloatArray:
        """Commanded position, (n,), mm."""
        c = self.calibration
        return (self.command_v - c.command_zero_v) / c.command_volts_per_mm


class Playback:
    """A waveform on its way through the output; the lever makes it."""

    def __init__(
        self,
        output: CardOutput,
        volts: FloatArray,
        *,
        expected_sample: int,
        triggered: bool,
        finder: StartFinder | None,
        samples_read: Callable[[], int],
        acquired: Callable[[], int] | None = None,
    ) -> None:
        self._output = output
        self._acquired = acquired
        self._out_before: int | None = None
        self.volts = volts
        self._expected = expected_sample
        self._triggered = triggered
        self._finder = finder
        self._samples_read = samples_read
        self._stopped = False

    @property
    def n(self) -> int:
        """Number of samples of the waveform."""
        return len(self.volts)

    @property
    def expected_sample(self) -> int:
        """The recording's sample at which the first sample is expected: while the start was ordered."""
        return self._expected

    @property
    def started_sample(self) -> int | None:
        """The recording's sample at which the first sample of the waveform was out, exact by loop-back.

        None while the samples read so far do not show it yet, or where it can't be known (no
        loop-back wired, or a waveform that does not move). Without loop-back, a start by the common
        trigger is taken at its word: 0.
        """
        if self._finder is not None:
            return self._finder.started_sample
        return self._expected if self._triggered else None

    @property
    def alignment_unknown(self) -> bool:
        """True where the place of the command can't be known to the sample: loop-back not wired."""
        return self._finder is None and not self._triggered

    @property
    def stopped(self) -> bool:
        """True when it was stopped before its end."""
        return self._stopped

    @property
    def done(self) -> bool:
        """True when the whole waveform is out, or stopped, and the samples read reach past its end.

        Raises OutputStarvedError or another CardError where the card stopped it.
        """
        if self._stopped:
            return True
        started = self.started_sample
        begin = self._expected if started is None else started
        if self._samples_read() < begin + self.n:
            return False
        if self._out_before is None:
            if not self._output.done():
                return False
            # one that began later than expected, on a busy computer, may not be in what was read so far
            acquired = self._acquired if started is None else None
            self._out_before = begin if acquired is None else acquired()
        return self._samples_read() >= self._out_before

    def mark_stopped(self) -> None:
        """The lever has stopped it."""
        self._stopped = True

    @property
    def sent_v(self) -> FloatArray:
        """What the card was given of the waveform, V."""
        return self.volts

    @property
    def starved(self) -> bool:
        """True when it stopped by itself for want of samples; the arm stands where it had got to."""
        return False


class StreamPlayback(Playback):
    """A waveform of which the card holds only the next moments.

    ``lead_samples``: how many samples the card may have beyond the last one that was looked at. Whatever
    happens to program, computer or card server, the arm goes no further than that.
    """

    def __init__(
        self,
        output: CardStream,
        volts: FloatArray,
        *,
        expected_sample: int,
        not_before: int,
        lead_samples: int,
        finder: StartFinder | None,
        samples_read: Callable[[], int],
    ) -> None:
        super().__init__(
            output,
            volts,
            expected_sample=expected_sample,
            triggered=False,
            finder=finder,
            samples_read=samples_read,
        )
        self._stream = output
        self._not_before = not_before
        self._lead = lead_samples
        self._released = min(lead_samples, len(volts))
        self._starved = False

    @property
    def sent_v(self) -> FloatArray:
        """What the card was given of the waveform so far, V."""
        return self.volts[: self._released]

    @property
    def starved(self) -> bool:
        """True when it stopped by itself for want of samples; the arm stands where it had got to."""
        return self._starved

    @property
    def done(self) -> bool:
        """True when it was stopped, ran dry, or the samples read reach past the end of the whole waveform."""
        if self._stopped or self._starved:
            return True
        started = self.started_sample
        begin = self._expected if started is None else started
        return self._released == self.n and self._samples_read() >= begin + self.n

    def release(self, judged: int) -> None:
        """Give the card what may follow now that the samples before ``judged`` were looked at.

        Raises OutputStarvedError where it had run dry.
        """
        started = self.started_sample
        out = judged - (self._not_before if started is None else started)
        if started is None:
            # not known to the sample yet: no sooner than it was ordered, no further than the card says
            out = min(out, self._stream.generated())
        n = min(out + self._lead, self.n) - self._released
        if n < self._lead // _PIECES and (n <= 0 or self._released + n < self.n):
            return
        self._stream.write(self.volts[self._released : self._released + n])
        self._released += n

    def mark_starved(self) -> None:
        """It has run dry."""
        self._starved = True
