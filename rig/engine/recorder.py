"""Samples of one trial as the program acts on them, and what it notes beside them in the file."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from analysis.recordings import TrialWriter
from analysis.recordings.trial import Event, FloatArray, Phase, Surface
from rig.hardware.errors import HardwareError, LimitHit
from rig.hardware.lever import Chunk, Lever, Playback

_AFTER_LIMIT_S = 0.3
"""Still recorded after a limit was hit: the arm on its way out."""


class Recorder:
    """Takes every sample of a trial once, in order; the file gets them on a road of its own (`Filing`).

    What it notes is written by `note`, so that no motion waits for the disk. `check` is called before each read
    and may raise to end the trial; `follow` is handed every chunk, `mark` the name of every phase that begins, its
    first sample and the number of samples by now.
    Where nothing has to be noticed at once, `read_s` are read at a time.
    """

    def __init__(
        self,
        lever: Lever,
        writer: TrialWriter,
        note: Callable[[Callable[[], None]], None],
        check: Callable[[], None],
        follow: Callable[[Chunk], None],
        mark: Callable[[str, int, int], None] = lambda *_: None,
        *,
        read_s: float = 0.05,
    ) -> None:
        self._lever = lever
        self._writer = writer
        self._note = note
        self._check = check
        self._follow = follow
        self._mark = mark
        self.read_samples = max(1, int(read_s * lever.sample_rate_hz))
        self._position_mm = np.empty(0)
        self._force_mn = np.empty(0)
        self._command_v = np.empty(0)
        self._phases: list[Phase] = []
        self._in_phase = False
        self.n = 0

    @property
    def position_mm(self) -> FloatArray:
        """Positions of the trial so far, (n,), mm."""
        return self._position_mm[: self.n]

    @property
    def force_mn(self) -> FloatArray:
        """Forces of the trial so far, (n,), mN."""
        return self._force_mn[: self.n]

    @property
    def command_v(self) -> FloatArray:
        """Command of the trial so far, (n,), V, as known when it was read."""
        return self._command_v[: self.n]

    def take(self, n: int) -> Chunk:
        """Read the next n samples and hand them on; after a limit hit, what follows it as well."""
        self._check()
        try:
            return self._next(n)
        except LimitHit as hit:
            self.cut_short(hit.sample)
            self.note(hit.sample, "limit", str(hit))
            self._keep_after_limit()
            raise

    def take_until(self, stop: int) -> None:
        """Record up to sample `stop`, exclusive."""
        while self.n < stop:
            self.take(min(self.read_samples, stop - self.n))

    def take_for(self, duration_s: float) -> None:
        """Record for a length of time."""
        self.take_until(self.n + round(duration_s * self._lever.sample_rate_hz))

    def take_while_playing(self, playback: Playback) -> None:
        """Record until a waveform is at its end, or stopped."""
        while not playback.done:
            self.take(self.read_samples)

    def started(self, playback: Playback) -> int:
        """Return the sample at which a waveform began to move, reading on until it is known.

        Where it can't be known to the sample, where it was expected, with an event that says so.
        """
        step = max(1, int(0.005 * self._lever.sample_rate_hz))
        while playback.started_sample is None and not playback.alignment_unknown and not playback.done:
            self.take(step)
        if playback.started_sample is not None:
            return playback.started_sample
        why = "no loop-back is wired" if playback.alignment_unknown else "the loop-back does not show it"
        self.note(
            playback.expected_sample,
            "alignment",
            f"the command's place among the samples is not known exactly: {why}",
        )
        return playback.expected_sample

    def begin_phase(self, name: str, sample: int) -> None:
        """The phase before ends at `sample` and this one begins; `sample` may lie in the past."""
        if self._phases:
            last = self._phases[-1]
            self._phases[-1] = Phase(last.name, last.start, max(sample, last.start))
        # never empty, so that after a kill the file says which phase had begun
        self._phases.append(Phase(name, sample, max(sample + 1, self.n)))
        self._in_phase = True
        self._note_phases()
        self._mark(name, sample, self.n)

    def end_phase(self, sample: int | None = None) -> None:
        """The last phase ends at `sample`, or where the samples end."""
        if self._phases:
            last = self._phases[-1]
            self._phases[-1] = Phase(last.name, last.start, self.n if sample is None else sample)
            self._in_phase = False
            self._note_phases()

    def cut_short(self, sample: int | None = None) -> None:
        """The trial ends before its time: the phase under way, if any, ends at `sample`, or with the samples."""
        if self._in_phase:
            self.end_phase(max(self.n if sample is None else sample, self._phases[-1].start))

    def surface(self, surface: Surface) -> None:
        """Keep where the surface was found."""
        self._note(partial(self._writer.set_surface, surface))

    def note(self, sample: int, kind: str, message: str) -> None:
        """Keep an event with the trial."""
        self._note(partial(self._writer.add_event, Event(sample, kind, message)))

    def _note_phases(self) -> None:
        self._note(partial(self._writer.set_phases, tuple(self._phases)))

    def _keep_after_limit(self) -> None:
        """Record the arm's way out; where even that fails, the limit hit is what is told."""
        try:
            self._next(round(_AFTER_LIMIT_S * self._lever.sample_rate_hz))
        except HardwareError as error:
            self.note(self.n, "recording", f"nothing recorded after the limit was hit: {error}")

    def _next(self, n: int) -> Chunk:
        chunk = self._lever.read(n)
        self._keep(chunk)
        self._follow(chunk)
        return chunk

    def _keep(self, chunk: Chunk) -> None:
        needed = self.n + chunk.n
        if needed > len(self._position_mm):
            more = np.empty(max(needed, 2 * len(self._position_mm), 1 << 16))
            self._position_mm = np.concatenate([self.position_mm, more[self.n :]])
            self._force_mn = np.concatenate([self.force_mn, more[self.n :]])
            self._command_v = np.concatenate([self.command_v, more[self.n :]])
        self._position_mm[self.n : needed] = chunk.position_mm
        self._force_mn[self.n : needed] = chunk.force_mn
        self._command_v[self.n : needed] = chunk.command_v
        self.n = needed
