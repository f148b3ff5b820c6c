"""All that ends a motion of the arm: a limit, a sample that was looked for, the program, the way to safety."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import Calibration
from rig.hardware.drive import Drive
from rig.hardware.errors import (
    CardError,
    GuardError,
    LimitHit,
    LimitRefusedError,
    NotWiredError,
    RetreatFailedError,
)
from rig.hardware.limits import Watch
from rig.hardware.playback import Chunk, Playback
from rig.hardware.recorder import Recorder
from rig.hardware.retreat import LATE_S, SETTLE_S, RetreatWatch, way_to_safety_v
from rig.settings.rig_file import RigFile

FloatArray = NDArray[np.float64]

_AFTER_STOP = 8
"""Samples averaged after a stop to read back where it stopped."""

_LOOPBACK_TOLERANCE_MM = 0.05
"""A loop-back that differs by more from the command at rest is not wired to it."""


class Brake:
    """Stops what the drive plays.

    `inspect` runs in the reader thread and acts there, so that nothing stands between a sample and the
    stop; everything else is called by the program's thread.
    """

    def __init__(self, drive: Drive, rig: RigFile, calibration: Calibration) -> None:
        self._drive = drive
        self._settings = rig.card
        self._limits = rig.lever
        self._calibration = calibration
        self._wired = rig.card.loopback_channel is not None
        self._usual_noise_v = 0.0
        self._limit_hit = False
        self._retreating = False
        self._fleeing: Playback | None = None
        self._usual_read_samples = 0
        self._way: RetreatWatch | None = None
        self._way_failed: RetreatFailedError | None = None
        self.prepare()

    def prepare(self) -> None:
        """Begin anew with a recording: nothing is looked for, the limits are watched from its start."""
        self._watch = Watch(self._limits, self._calibration, self._settings.range_v, self._usual_noise_v)
        self._seen: Callable[[Chunk], bool] | None = None
        self._halted: Playback | None = None
        self._flee_asked = False

    def expect_noise(self, noise_v: float) -> None:
        """The force signal of the free arm was seen to have this noise, V rms; recordings begun later hold it to it."""
        self._usual_noise_v = min(self._usual_noise_v or noise_v, noise_v)

    def flee(self) -> None:
        """Have the arm leave for safety at the reader's next samples; from any thread, a signal's handler too."""
        self._flee_asked = True

    def look_for(self, seen: Callable[[Chunk], bool], recorder: Recorder, samples_per_read: int) -> None:
        """Stop the output once ``seen`` returns True; the thread reads so many samples at a time meanwhile."""
        self.look_no_longer(recorder)
        self._usual_read_samples, recorder.read_samples = recorder.read_samples, samples_per_read
        self._seen = seen

    @property
    def looking(self) -> bool:
        """Whether something is looked for and has not been seen yet."""
        return self._seen is not None

    def look_no_longer(self, recorder: Recorder) -> None:
        """Nothing stops the output any more but its end, a limit or the program."""
        self._seen = None
        if self._usual_read_samples:
            recorder.read_samples, self._usual_read_samples = self._usual_read_samples, 0

    def refuse_after_limit(self) -> None:
        """Raise LimitRefusedError where the arm is on its own way to safety, and has not been there since."""
        if self._limit_hit:
            raise LimitRefusedError(
                "the arm left for safety by itself; nothing was sent; retreat before the next motion"
            )

    def inspect(self, recorder: Recorder, start: int, block: FloatArray) -> None:
        """Look at the next samples, (n_channels, n), V: on a limit, begin the retract, then raise LimitHit."""
        self._drive.beat("reader")
        if self._limit_hit or self._retreating:
            self._watch_way(block)
            return
        self._heed_watcher(recorder, block)
        if self._flee_asked and self._drive.away:
            self._flee(recorder, block, "the arm was to leave")
            return
        command_v = block[2] if self._wired else self._drive.sent_v(start, start + block.shape[1])
        try:
            self._watch.check(start, block[0], block[1], command_v)
        except LimitHit as hit:
            self._flee(recorder, block, f"{hit.limit} limit hit at {hit.position_mm:.3f} mm")
            raise
        seen = self._seen
        if seen is not None and seen(Chunk(start, block[0], block[1], command_v, self._calibration)):
            self._seen = None
            self._stop()
        else:
            self._drive.release(start + block.shape[1])

    def set_ceiling(self, force_mn: float | None) -> None:
        """Let a motion reverse above this force, mN; None: above the rig's own limit only."""
        self._watch.ceiling_mn = force_mn

    def set_surface(self, surface_mm: float) -> None:
        """The arm goes no deeper than the rig's largest depth below this surface, mm, while recording lasts."""
        self._watch.surface_mm = surface_mm

    @property
    def deepest_mm(self) -> float:
        """How far the arm may go, mm, once a surface was found: the rig's largest depth below it."""
        return self._watch.deepest_mm

    def halt(self, recorder: Recorder) -> None:
        """Stop the output, unless that has been done, and find out where it was; see `Lever.halt`."""
        with self._drive.lock:
            self.look_no_longer(recorder)
            if self._limit_hit:
                return  # on its way to safety: nothing halts that
            self._stop()
            playback = self._halted
        if playback is None:
            return
        # the sample under way at the stop and the next may still show the motion
        first = recorder.acquired() + 2
        recorder.wait_for(first + _AFTER_STOP, heed=False)
        with self._drive.lock:
            # else a limit was hit meanwhile, and the arm is on its way
            if self._halted is playback:
                self._stopped_at(recorder.peek(first, first + _AFTER_STOP), first)

    def retreat(self, recorder: Recorder) -> None:
        """Move to the safe position with the inputs running on, so that the way is recorded too."""
        rate_hz = self._settings.sample_rate_hz
        self._retreating = True
        try:
            playback = self._way_under_way()
            if playback is None:
                self.halt(recorder)
                last = recorder.filled
                seen = recorder.peek(max(last - _AFTER_STOP, 0), last)
                playback = self._begin_way_to_safety(recorder, seen)
            n_settle = round(SETTLE_S * rate_hz)
            stop = playback.expected_sample + playback.n + n_settle
            recorder.wait_for(stop, heed=False)
            while self._way_failed is None and self._drive.moving():
                stop += n_settle
                if stop > playback.expected_sample + playback.n + LATE_S * rate_hz:
                    raise RetreatFailedError("the output of the card does not end")
                recorder.wait_for(stop, heed=False)
            if self._way_failed is None:
                # on a busy computer the output began late, and what was read so far may still show the way
                stop = recorder.acquired() + n_settle
                recorder.wait_for(stop, heed=False)
            seen = recorder.peek(stop - n_settle // 2, stop).mean(axis=1)
        finally:
            self._retreating, self._way, self._fleeing = False, None, None
            failed, self._way_failed = self._way_failed, None
        if failed is not None:
            raise failed
        c, safe_mm = self._calibration, self._limits.safe_position_mm
        position_mm = (float(seen[0]) - c.position_zero_v) / c.volts_per_mm
        if abs(position_mm - safe_mm) > self._limits.following_error_max_mm:
            raise RetreatFailedError(f"the arm is at {position_mm:.2f} mm instead of {safe_mm:g} mm")
        self.arrived()
        if self._wired:
            loopback_mm = (float(seen[2]) - c.command_zero_v) / c.command_volts_per_mm
            if abs(loopback_mm - safe_mm) > _LOOPBACK_TOLERANCE_MM:
                raise NotWiredError(
                    f"card.loopback_channel reads {loopback_mm:.2f} mm while {safe_mm:g} mm is sent; wire "
                    "the output to that input, or take the key out of rig.toml"
                )

    def arrived(self) -> None:
        """The arm rests at the safe position."""
        self._limit_hit, self._fleeing = False, None
        self.prepare()
        self._drive.arrived()

    def _way_under_way(self) -> Playback | None:
        """The way to safety that the reader thread has begun and that has not failed."""
        with self._drive.lock:
            return self._fleeing if self._way is not None else None

    def _stop(self) -> None:
        with self._drive.lock:
            stopped = self._drive.stop(count=not self._wired)
            if stopped is not None:
                self._halted = stopped[0]

    def _stopped_at(self, samples: FloatArray, at: int) -> None:
        """What was stopped ended where the loop-back of these samples, (n_channels, n), says, if it is wired.

        One that shows nothing that was sent is broken: then by the clock, ``at`` being the last sample.
        """
        with self._drive.lock:
            playback, self._halted = self._halted, None
            if playback is not None and self._wired:
                away_v = np.abs(playback.sent_v - samples[2].mean())
                last = int(np.argmin(away_v))
                if away_v[last] > _LOOPBACK_TOLERANCE_MM * abs(self._calibration.command_volts_per_mm):
                    last = min(max(at - playback.expected_sample, 0), len(away_v) - 1)
                self._drive.correct_stop(last + 1, float(playback.volts[last]))

    def _heed_watcher(self, recorder: Recorder, block: FloatArray) -> None:
        """Bring the arm to safety as soon as nobody watches over it; raises GuardError then."""
        if not self._drive.away:
            return
        try:
            self._drive.check_watcher()
        except GuardError:
            self._flee(recorder, block, "the guard is gone")
            raise

    def _flee(self, recorder: Recorder, block: FloatArray, why: str) -> None:
        """Begin the way to safety from within the reader thread."""
        self._limit_hit = True
        try:
            with self._drive.lock:
                # stopped, and not read back yet: what came last is nearest to where the arm is
                self._stopped_at(block[:, -1:], recorder.filled + block.shape[1])
                self._fleeing = self._begin_way_to_safety(recorder, block[:, -_AFTER_STOP:], who="reader")
        except CardError as error:
            raise RetreatFailedError(
                f"{why} and the arm could not be moved away, lift it by hand: {error}"
            ) from error

    def _watch_way(self, block: FloatArray) -> None:
        """Stop a way to safety that presses; whoever waits for its end is told."""
        if self._way is None:
            return
        try:
            self._way.check(block[:, -_AFTER_STOP:])
        except RetreatFailedError as failure:
            self._way, self._way_failed = None, failure
            self._drive.stop(count=False)
            raise

    def _begin_way_to_safety(self, recorder: Recorder, seen: FloatArray, who: str = "engine") -> Playback:
        with self._drive.lock:
            self._drive.stop()
            held_v, safe_v = self._drive.held_v, self._drive.safe_v
            volts = way_to_safety_v(held_v, safe_v, self._calibration, self._limits, self._settings)
            self._way = RetreatWatch(seen, safe_v - held_v, self._calibration)
            return self._drive.start(volts, acquired=recorder.acquired, taken=lambda: recorder.taken, who=who)
