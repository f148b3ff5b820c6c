"""The arm in millimetres and millinewtons: it moves as told, is recorded, and is held to its limits."""

from __future__ import annotations

from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import Calibration
from rig.rig_file import LeverSettings, RigFile

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
    """A waveform on its way through the output."""

    @property
    def n(self) -> int:
        """Number of samples of the waveform."""
        raise NotImplementedError

    @property
    def expected_sample(self) -> int:
        """The recording's sample at which the first sample is expected: right after the start was ordered."""
        raise NotImplementedError

    @property
    def started_sample(self) -> int | None:
        """The recording's sample at which the first sample of the waveform was out, exact by loop-back.

        None while the samples read so far do not show it yet, or where it can't be known (no
        loop-back wired, or a waveform that does not move).
        """
        raise NotImplementedError

    @property
    def alignment_unknown(self) -> bool:
        """True where the place of the command can't be known to the sample: loop-back not wired."""
        raise NotImplementedError

    @property
    def done(self) -> bool:
        """True when the whole waveform is out and the samples read reach past its end."""
        raise NotImplementedError


class Lever:
    """The arm, as a context manager: opens the card, and leaves the arm at the safe position.

    One thread of the program uses it; a reader thread of its own fetches and watches the samples.
    """

    sample_rate_hz: float
    calibration: Calibration
    limits: LeverSettings

    def __init__(self, rig: RigFile, card_address: str, calibration: Calibration) -> None:
        """``card_address`` with "companion:" already resolved; ``calibration`` measured or nominal."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        raise NotImplementedError

    @property
    def commanded_mm(self) -> float:
        """Where the arm was last told to be, mm; before the first motion, where it is."""
        raise NotImplementedError

    @property
    def acquired(self) -> int:
        """Samples fetched from the card so far, read by the program or not."""
        raise NotImplementedError

    def start_recording(self) -> None:
        """Start the inputs, which run on until `stop_recording`; sample 0 is the first after the start."""
        raise NotImplementedError

    def read(self, n: int, timeout_s: float | None = None) -> Chunk:
        """Return the next ``n`` samples in order, waiting for them.

        Raises SamplesLostError on a gap, SamplesLateError after ``timeout_s`` (default: their duration
        and 5 s), and LimitHit once, after the retract has begun; reading on then gives what follows.
        """
        raise NotImplementedError

    def play(self, waveform_mm: FloatArray) -> Playback:
        """Load the whole finite waveform (n,), mm, one value a sample, and start it; return at once.

        It must begin where the arm is commanded to be (within a step of the speed limit). Raises
        LimitRefusedError before anything is sent where it leaves the travel, is too fast or no number.
        """
        raise NotImplementedError

    def record_once(self, waveform_mm: FloatArray, tail_s: float = 0.0) -> tuple[Chunk, Playback]:
        """Play a waveform and record it from its first sample, started by one trigger; recording must be off.

        The chunk holds n + tail_s * sample_rate_hz samples.
        """
        raise NotImplementedError

    def halt(self) -> float:
        """Stop the output now; return the commanded position in mm where it stopped, read back."""
        raise NotImplementedError

    def retreat(self) -> None:
        """Move slew-limited to the safe position and wait until it is there.

        Works after any failure of the current tasks (they are cleared and made anew). Raises
        RetreatFailedError where the arm can't be moved.
        """
        raise NotImplementedError

    def stop_recording(self) -> None:
        """Stop the inputs; samples fetched and not yet read are dropped."""
        raise NotImplementedError
