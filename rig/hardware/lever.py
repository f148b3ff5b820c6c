"""The arm in millimetres and millinewtons: it moves as told, is recorded, and is held to its limits."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import Calibration
from rig.errors import RigError
from rig.hardware import proof
from rig.hardware.brake import Brake
from rig.hardware.daq import Card, CardInput
from rig.hardware.drive import ArmWatcher, Drive
from rig.hardware.errors import (
    CardError,
    HardwareError,
    LimitRefusedError,
    NotWiredError,
    RetreatFailedError,
)
from rig.hardware.limits import lead_s, volts_within_limits
from rig.hardware.playback import Chunk, Playback
from rig.hardware.probe import probe
from rig.hardware.recorder import Recorder
from rig.hardware.retreat import LATE_S, bring_to_safety, output_now_v
from rig.settings.rig_file import RigFile

__all__ = ["Chunk", "Lever", "Playback"]

FloatArray = NDArray[np.float64]

_log = logging.getLogger(__name__)

_RING_S = 60.0
"""Samples fetched and not yet read that are kept, s; beyond, the driver's buffer fills."""

_AT_REST = 16
"""Samples at rest that precede every motion."""


class Lever:
    """The arm, as a context manager: opens the card, and leaves the arm at the safe position if it moved.

    One thread of the program uses it; a reader thread of its own fetches and watches the samples.
    ``card_address`` with "companion:" already resolved; ``calibration`` measured or nominal. ``guard``
    is told when the arm leaves the safe position and when it is back.
    """

    def __init__(
        self, rig: RigFile, card_address: str, calibration: Calibration, guard: ArmWatcher | None = None
    ) -> None:
        self.sample_rate_hz = rig.card.sample_rate_hz
        self.calibration = calibration
        self.limits = rig.lever
        self._settings = rig.card
        self._card = Card(card_address, rig.card.device, tls=rig.card.tls)
        self._drive = Drive(self._card, rig.card, guard, self._volts_at(rig.lever.safe_position_mm))
        self._brake = Brake(self._drive, rig, calibration)
        self._recorder: Recorder | None = None

    def __enter__(self) -> Self:
        c, wired = self.calibration, self.loopback_wired
        try:
            with contextlib.closing(self._open_input()) as source:
                source.start()
                seen = source.read(round(proof.LOOK_S * self.sample_rate_hz), timeout_s=LATE_S)
            proof.prove_at_rest(seen, c, self.limits, loopback_wired=wired)
            held_v = output_now_v(seen, c, self.limits, loopback_wired=wired, bearings=None)
        except HardwareError:
            self._card.close()
            raise
        self._drive.rest_at(held_v)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if self._drive.away:
                self.retreat()
        except HardwareError as failure:
            if error is None:
                raise
            _log.error("on the way out: %s", failure)
        finally:
            self._drop_tasks()
            self._card.close()

    @property
    def loopback_wired(self) -> bool:
        """Whether the command can be read back."""
        return self._settings.loopback_channel is not None

    @property
    def commanded_mm(self) -> float:
        """Where the arm was last told to be, mm: the end of the last motion, or where it was stopped.

        Before the first motion it is read back from the loop-back; without one it is the recorded
        position, which is as good as the calibration, until the first `retreat` has made it exact.
        """
        c = self.calibration
        return (self._drive.held_v - c.command_zero_v) / c.command_volts_per_mm

    @property
    def acquired(self) -> int:
        """Samples fetched from the card so far, read by the program or not."""
        return 0 if self._recorder is None else self._recorder.filled

    def start_recording(self, keep: Callable[[Chunk], None] | None = None) -> None:
        """Start the inputs, which run on until `stop_recording`; sample 0 is the first after the start.

        ``keep`` is handed every chunk once, in order, by the reader thread as soon as it has been looked
        at, long before `read` may ask for it: it must not wait. Where no loop-back is wired the command
        in it may run on for some samples after a stop; that of `read` does not.
        """
        self._refuse_while_recording()
        self._record(self._open_input(), keep)

    def read(self, n: int, timeout_s: float | None = None) -> Chunk:
        """Return the next ``n`` samples in order, waiting for them.

        Raises SamplesLostError on a gap, SamplesLateError after ``timeout_s`` (default: their duration
        and 5 s), and LimitHit once, after the retract has begun; reading on then gives what follows.
        """
        recorder = self._recording()
        start = recorder.taken
        chunk = self._chunk(start, recorder.take(n, timeout_s))
        if self.loopback_wired:
            self._drive.feed(start, chunk.command_v)
        return chunk

    def play(self, waveform_mm: FloatArray) -> Playback:
        """Load the whole finite waveform (n,), mm, one value a sample, and start it; return at once.

        It must begin where the arm is commanded to be (within a step of the speed limit). Raises
        LimitRefusedError before anything is sent where it leaves the travel, is too fast or no number,
        or while the arm still moves.
        """
        recorder = self._recording()
        volts = self._checked(waveform_mm)
        # the loop-back must have been seen at rest to tell when it leaves it
        recorder.wait_for(recorder.acquired() + _AT_REST)
        with self._drive.lock:
            # the reader thread may have hit a limit since the check
            self._brake.refuse_after_limit()
            return self._drive.start(volts, acquired=recorder.acquired, taken=self._taken)

    def play_until(
        self, waveform_mm: FloatArray, seen: Callable[[Chunk], bool], samples_per_read: int
    ) -> Playback | None:
        """Play until ``seen`` returns True for the samples fetched, with the output written just ahead.

        The reader thread itself shows ``seen`` every block when it comes, ``samples_per_read`` samples or,
        where the computer was late, more, so that nothing stands between a sample and the stop.
        `Playback.stopped` says that it has happened, `halt` where. The card never holds more than the next
        `lead_s` of the motion, given to it only after the latest samples were looked at: when program,
        computer or card server stand still the arm stops by itself, and `Playback.starved` says so; then
        `go_on`. None where ``seen`` was True before the arm moved.
        """
        recorder = self._recording()
        self._brake.look_for(seen, recorder, samples_per_read)
        try:
            return self._stream(waveform_mm)
        except HardwareError:
            self._brake.look_no_longer(recorder)
            raise

    def go_on(self, waveform_mm: FloatArray) -> Playback | None:
        """Begin the rest of a motion of `play_until` that starved; all samples up to now are looked at first.

        None where what is looked for has been seen meanwhile: the arm then stays where it is.
        """
        return self._stream(waveform_mm)

    def record_once(self, waveform_mm: FloatArray, tail_s: float = 0.0) -> tuple[Chunk, Playback]:
        """Play a waveform and record it from its first sample, started by one trigger.

        Recording must be off. The chunk holds n + tail_s * sample_rate_hz samples.
        """
        self._refuse_while_recording()
        volts = self._checked(waveform_mm)
        source = self._open_input()
        try:
            playback = self._drive.start_with_inputs(volts, taken=self._taken)
        except CardError:
            source.close()
            raise
        try:
            # the output waits for the trigger that the start of the inputs gives
            self._record(source)
            return self.read(len(volts) + round(tail_s * self.sample_rate_hz)), playback
        finally:
            self.stop_recording()

    def halt(self) -> float:
        """Stop the output now; return the commanded position in mm where it stopped, read back.

        With loop-back it is read there; without, it is where the card had got to when it was asked,
        some samples before the stop. Samples from after the stop have been `acquired` then.
        """
        self._brake.halt(self._recording())
        return self.commanded_mm

    def flee(self) -> None:
        """Have the arm leave for safety within a read, whatever the program's thread does; from any thread.

        It only sets a flag, for the thread that reads: where recording is off nothing happens. Motions are
        refused from then on; `retreat` waits for its arrival.
        """
        self._brake.flee()

    def retreat(self) -> None:
        """Move slew-limited to the safe position and wait until it is there.

        Works after any failure of the current tasks: they are cleared and made anew, and recording has
        then ended. Raises RetreatFailedError where the arm can't be moved.
        """
        recorder = self._recorder
        if recorder is not None and recorder.alive:
            try:
                self._brake.retreat(recorder)
            except NotWiredError:
                raise
            except HardwareError as error:
                _log.warning("retreat while recording failed, taking new tasks: %s", error)
            else:
                return
        self._drop_tasks()
        try:
            done = bring_to_safety(
                self._card,
                self._settings,
                self.limits,
                self.calibration,
                self._drive.bearings,
                self._alive,
            )
        except CardError as error:
            raise RetreatFailedError(f"the arm could not be moved away, lift it by hand: {error}") from error
        _log.info("arm moved from %.3f to %.3f mm", done.from_mm, done.to_mm)
        self._drive.rest_at(self._drive.safe_v)
        self._brake.arrived()

    def prove(self) -> None:
        """Move the arm a little at the safe position, to see that every signal says so; see `probe`.

        Raises ArmNotProvenError where one does not, or where the force is not that of a free arm.
        """
        self._brake.expect_noise(probe(self))
        self._brake.arrived()

    def look_for_force(self, force_mn: float | None) -> None:
        """Reverse every motion above this force, mN, until told otherwise; None: above the rig's limit only."""
        self._brake.set_ceiling(force_mn)

    def surface_found(self, position_mm: float) -> None:
        """The arm goes no deeper than the rig's largest depth below this position while recording lasts."""
        self._brake.set_surface(position_mm)

    def stop_recording(self) -> None:
        """Stop the inputs; samples fetched and not yet read are dropped.

        Raises LimitHit where a limit was hit and no `read` has told.
        """
        recorder, self._recorder = self._recorder, None
        if recorder is not None:
            self._drive.rest_at(self._drive.held_v)
            recorder.stop()

    def _stream(self, waveform_mm: FloatArray) -> Playback | None:
        recorder = self._recording()
        volts = self._checked(waveform_mm)
        speed_mm_s = float(np.abs(np.diff(waveform_mm)).max()) * self.sample_rate_hz
        recorder.wait_for(recorder.acquired() + _AT_REST)
        with self._drive.lock:
            self._brake.refuse_after_limit()
            if not self._brake.looking:
                return None
            return self._drive.start_stream(
                volts,
                lead_samples=round(lead_s(speed_mm_s) * self.sample_rate_hz),
                acquired=recorder.acquired,
                taken=self._taken,
            )

    def _chunk(self, start: int, block: FloatArray) -> Chunk:
        """The chunk of samples (n_channels, n), V."""
        command_v = block[2] if self.loopback_wired else self._drive.sent_v(start, start + block.shape[1])
        return Chunk(start, block[0], block[1], command_v, self.calibration)

    def _alive(self) -> None:
        """Where the program reads the card itself, it is the reader too."""
        for who in ("engine", "reader"):
            self._drive.beat(who)

    def _taken(self) -> int:
        return 0 if self._recorder is None else self._recorder.taken

    def _volts_at(self, mm: float) -> float:
        return mm * self.calibration.command_volts_per_mm + self.calibration.command_zero_v

    def _checked(self, waveform_mm: FloatArray) -> FloatArray:
        """The waveform in volts, or LimitRefusedError."""
        self._brake.refuse_after_limit()
        self._drive.check_watcher()
        if self._drive.moving():
            raise LimitRefusedError("the arm still moves; nothing was sent; wait for its end, or halt it")
        deepest_mm = self._brake.deepest_mm
        if float(np.max(waveform_mm, initial=-np.inf)) > max(deepest_mm, self.commanded_mm) + 1e-6:
            raise LimitRefusedError(
                f"the motion goes to {waveform_mm.max():.3f} mm, beyond the {deepest_mm:.3f} mm that "
                "lever.depth_max_mm allows below the surface found; nothing was sent; lower the depth"
            )
        return volts_within_limits(
            waveform_mm,
            self.limits,
            self.calibration,
            rate_hz=self.sample_rate_hz,
            range_v=self._settings.range_v,
            from_mm=self.commanded_mm,
        )

    def _refuse_while_recording(self) -> None:
        if self._recorder is not None:
            raise RigError("recording is on already; stop it before it is started again")

    def _recording(self) -> Recorder:
        if self._recorder is None:
            raise RigError("recording is off; start it before the arm is moved or read")
        return self._recorder

    def _open_input(self) -> CardInput:
        s = self._settings
        channels = [s.position_channel, s.force_channel]
        channels += [s.loopback_channel] if s.loopback_channel is not None else []
        return self._card.open_input(
            channels,
            rate_hz=s.sample_rate_hz,
            range_v=s.range_v,
            buffer_samples=round(s.input_buffer_s * s.sample_rate_hz),
        )

    def _record(self, source: CardInput, keep: Callable[[Chunk], None] | None = None) -> None:
        def look(start: int, block: FloatArray) -> None:
            try:
                self._brake.inspect(recorder, start, block)
            finally:
                # the arm first; and what follows a limit hit is kept as well
                if keep is not None:
                    keep(self._chunk(start, block.copy()))

        self._brake.prepare()
        recorder = Recorder(
            source,
            rate_hz=self.sample_rate_hz,
            alive=lambda: self._drive.beat("engine"),
            ring_samples=round(_RING_S * self.sample_rate_hz),
            read_samples=max(round(self._settings.read_interval_s * self.sample_rate_hz), 1),
            inspect=look,
        )
        self._recorder = recorder
        recorder.start()

    def _drop_tasks(self) -> None:
        """Free the card of all tasks; what can't be freed any more is noted and left."""
        for close in (self._drive.close, self.stop_recording):
            try:
                close()
            except HardwareError as error:
                _log.warning("freeing the card: %s", error)
