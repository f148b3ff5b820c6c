"""The output side of the lever, in volts: waveforms one after the other, what is held, when each began."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rig.hardware.alignment import CommandTrack, StartFinder
from rig.hardware.daq import Card, CardOutput
from rig.hardware.errors import OutputStarvedError
from rig.hardware.playback import Playback, StreamPlayback
from rig.hardware.retreat import Bearings
from rig.settings.rig_file import CardSettings

FloatArray = NDArray[np.float64]

_HISTORY = 4096
"""Samples of loop-back kept from before a start, to know the rest it starts from."""

_BITS = 16
"""Resolution of an S Series output."""


class ArmWatcher(Protocol):
    """Whoever must know when the arm leaves the safe position and when it is back."""

    def arm_away(self, low_v: float, high_v: float, safe_v: float) -> None:
        """The arm is about to move; its output lies between these until the next word, and is safe at the last."""

    def arm_safe(self) -> None:
        """The arm rests at the safe position."""

    def beat(self, who: str) -> None:
        """The engine, or the reader, is alive."""

    def check(self) -> None:
        """Raise GuardError where the watcher itself is dead or silent."""


class Drive:
    """Sends waveforms and knows what the output holds.

    The program's thread and the reader thread (when a limit is hit) both use it: ``lock`` is held
    while the output changes, and nobody waits for samples under it.
    """

    def __init__(self, card: Card, settings: CardSettings, watcher: ArmWatcher | None, safe_v: float) -> None:
        self.lock = threading.RLock()
        self.away = False
        self.safe_v = safe_v
        """The output at which the arm is safe: by the constants, or where it was found to be so, V."""
        self._range_v = (float("nan"), float("nan"))
        self._card = card
        self._settings = settings
        self._watcher = watcher
        self._track = CommandTrack(float("nan"))
        self._output: CardOutput | None = None
        self._playback: Playback | None = None
        self._finders: list[StartFinder] = []
        self._history: FloatArray = np.empty(0)

    @property
    def bearings(self) -> Bearings | None:
        """What is known of the output while nobody can ask the card; None before anything was sent."""
        low_v, high_v = self._range_v
        return None if math.isnan(low_v) else Bearings(low_v, high_v, self.safe_v)

    def beat(self, who: str) -> None:
        """Say that the engine, or the reader, is alive."""
        if self._watcher is not None:
            self._watcher.beat(who)

    def check_watcher(self) -> None:
        """Raise GuardError where the watcher is dead or silent."""
        if self._watcher is not None:
            self._watcher.check()

    @property
    def held_v(self) -> float:
        """What the output holds once all that was sent is out, V."""
        return self._track.last_v

    def rest_at(self, volts: float) -> None:
        """The output holds ``volts``; sample counting begins anew."""
        with self.lock:
            self._track = CommandTrack(volts)
            self._finders, self._history = [], np.empty(0)

    def sent_v(self, start: int, stop: int) -> FloatArray:
        """The sent command at its expected place, samples ``start`` to ``stop`` (exclusive), V."""
        return self._track.volts(start, stop)

    def moving(self) -> bool:
        """Whether a waveform is still on its way; raises CardError where the card stopped it."""
        with self.lock:
            return self._output is not None and not self._output.done()

    def start(
        self,
        volts: FloatArray,
        *,
        acquired: Callable[[], int],
        taken: Callable[[], int],
        who: str = "engine",
    ) -> Playback:
        """Load a waveform and start it now; ``acquired`` and ``taken`` count the samples of the recording.

        ``who`` does it, and lives: the calls that it takes are long on a busy computer.
        """
        with self.lock:
            output = self._load(volts, on_input_start=False, who=who)
            not_before = acquired()
            output.start()
            # somewhere between the two answers
            expected = (not_before + acquired()) // 2
            return self._note(output, volts, not_before, expected, taken, acquired)

    def start_stream(
        self,
        volts: FloatArray,
        *,
        lead_samples: int,
        acquired: Callable[[], int],
        taken: Callable[[], int],
    ) -> Playback:
        """Start a waveform of which the card is given ``lead_samples``; `release` gives it the rest."""
        with self.lock:
            first = volts[:lead_samples]
            self._leave_safety(volts)
            s = self._settings
            output = self._card.open_stream(
                s.command_channel,
                first,
                rate_hz=s.sample_rate_hz,
                range_v=s.range_v,
                buffer_samples=2 * lead_samples,
                alive=lambda: self.beat("engine"),
            )
            self._output = output
            not_before = acquired()
            output.start()
            expected = (not_before + acquired()) // 2
            finder = self._find(volts, not_before, taken)
            self._track.begin(expected, volts, len(first))
            playback = StreamPlayback(
                output,
                volts,
                expected_sample=expected,
                not_before=not_before,
                lead_samples=lead_samples,
                finder=finder,
                samples_read=taken,
            )
            self._playback = playback
            return playback

    def release(self, judged: int) -> None:
        """Let a stream go on, now that the samples before ``judged`` were looked at and nothing was found.

        One that has run dry is over: the arm stands at the last sample that was sent.
        """
        playback = self._playback
        if self._output is None or not isinstance(playback, StreamPlayback):
            return  # without the lock: while an output is loaded, the samples are read and watched
        with self.lock:
            if self._output is None or self._playback is not playback:
                return
            try:
                playback.release(judged)
            except OutputStarvedError:
                self.close()
                playback.mark_starved()
                self.correct_stop(len(playback.sent_v), float(playback.sent_v[-1]))
            else:
                self._track.go_on(len(playback.sent_v))

    def start_with_inputs(self, volts: FloatArray, *, taken: Callable[[], int]) -> Playback:
        """Load a waveform that begins with the first sample of the inputs, which are started next."""
        with self.lock:
            output = self._load(volts, on_input_start=True, who="engine")
            output.start()
            return self._note(output, volts, 0, 0, taken, None)

    def stop(self, *, count: bool = True) -> tuple[Playback, int] | None:
        """Stop now; the waveform that was the last and how many of its samples were out, or None.

        Asking how many takes time while the arm moves on. Without ``count`` it is all of them, for a
        caller who sees in the loop-back where the arm was stopped.
        """
        with self.lock:
            output, playback = self._output, self._playback
            if output is None or playback is None:
                return None
            sent = len(playback.sent_v)
            n_played = min(max(_generated(output, sent), 1), sent) if count else sent
            self.close()
            playback.mark_stopped()
            self.correct_stop(n_played, float(playback.volts[n_played - 1]))
            return playback, n_played

    def correct_stop(self, n_played: int, held_v: float) -> None:
        """The last waveform was stopped after ``n_played`` samples; what is held is ``held_v``."""
        if self._playback is not None:
            for finder in self._finders:
                finder.end_at(self._playback.expected_sample + n_played)
        self._track.cut(n_played, held_v)

    def close(self) -> None:
        """Stop the output, which keeps its voltage, and free it; does nothing where there is none."""
        with self.lock:
            output, self._output = self._output, None
            if output is not None:
                output.close()

    def arrived(self) -> None:
        """The arm rests at the safe position."""
        self.away = False
        if self._watcher is not None:
            self._watcher.arm_safe()

    def feed(self, start: int, loopback_v: FloatArray) -> None:
        """Look for the start of what was sent in the next samples of the loop-back."""
        with self.lock:
            for finder in self._finders:
                finder.feed(start, loopback_v)
            self._finders = [finder for finder in self._finders if finder.searching]
            self._history = np.concatenate([self._history, loopback_v])[-_HISTORY:]

    def _leave_safety(self, volts: FloatArray) -> None:
        """Free the output for what comes next, and say that the arm is about to move."""
        self.close()
        self._range_v = (
            min(self.held_v, float(volts.min())),
            max(self.held_v, float(volts.max())),
        )
        self.away = True
        if self._watcher is not None:
            self._watcher.arm_away(*self._range_v, self.safe_v)

    def _load(self, volts: FloatArray, *, on_input_start: bool, who: str) -> CardOutput:
        self._leave_safety(volts)
        s = self._settings
        self._output = self._card.open_output(
            s.command_channel,
            volts,
            rate_hz=s.sample_rate_hz,
            range_v=s.range_v,
            on_input_start=on_input_start,
            alive=lambda: self.beat(who),
        )
        return self._output

    def _note(
        self,
        output: CardOutput,
        volts: FloatArray,
        not_before: int,
        expected: int,
        taken: Callable[[], int],
        acquired: Callable[[], int] | None,
    ) -> Playback:
        """Remember what was sent and when, and look for it in the loop-back from now on.

        Without ``acquired`` it begins at the ``expected`` sample exactly: one trigger starts both.
        """
        finder = self._find(volts, not_before, taken)
        self._track.add(expected, volts)
        self._playback = Playback(
            output,
            volts,
            expected_sample=expected,
            triggered=acquired is None,
            finder=finder,
            samples_read=taken,
            acquired=acquired,
        )
        return self._playback

    def _find(self, volts: FloatArray, not_before: int, taken: Callable[[], int]) -> StartFinder | None:
        """Look for the start of a waveform in the loop-back from now on; None where that is not wired."""
        for other in self._finders:
            other.end_at(not_before)
        if self._settings.loopback_channel is None:
            return None
        finder = StartFinder(volts, self._track.last_v, not_before, 2 * self._settings.range_v / 2**_BITS)
        finder.feed(taken() - len(self._history), self._history)
        self._finders.append(finder)
        return finder


def _generated(output: CardOutput, sent: int) -> int:
    """How many samples are out; all that was sent of an output that ran dry."""
    try:
        return output.generated()
    except OutputStarvedError:
        return sent
