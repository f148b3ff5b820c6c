"""A waveform on its way through the output, and the samples that come back meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import Calibration
from rig.hardware.alignment import StartFinder
from rig.hardware.daq import CardOutput

FloatArray = NDArray[np.float64]


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
    ) -> None:
        self._output = output
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
        return self._samples_read() >= begin + self.n and self._output.done()

    def mark_stopped(self) -> None:
        """The lever has stopped it."""
        self._stopped = True
