"""The way through the air to where a trial begins, bounded as an approach is; and what contact looks like."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from analysis.recordings.trial import FloatArray
from rig.engine.errors import ContactTooEarlyError
from rig.hardware.lever import Chunk, Lever
from rig.protocols.contact import ContactDetector
from rig.protocols.indenting import SKIN_MARGIN_MN
from rig.protocols.waveforms import ramp_mm

POSITIONING_MM_S = 10.0
"""Speed of a move away in the air before a recording; towards the finger it is the rig's speed of approach."""

_MET = (8, 10)
"""Something is met when so many of so many samples are above the threshold."""

_MET_READ = 80
_FREE_S = 0.01
"""How long the free arm's force is listened to before the way."""

SHORTEST_WAY = 2
"""Samples that a motion has at least."""


class Contact:
    """Tells contact in the samples of an approach, shown in the reader thread as soon as they come."""

    def __init__(self, detector: ContactDetector, free_mn: float) -> None:
        self._detector = detector
        self._free_mn = free_mn
        self._first: int | None = None
        self.decided: int | None = None
        """The sample that decided, counted from the start of the recording."""

    def __call__(self, chunk: Chunk) -> bool:
        """Look at the next samples; whether contact is told."""
        if self._first is None:
            self._first = chunk.start
        decided = self._detector.feed(chunk.force_mn - self._free_mn)
        if decided is not None:
            self.decided = self._first + decided
        return decided is not None


def move_to(lever: Lever, position_mm: float, threshold_mn: float, check: Callable[[], None]) -> None:
    """Move in the air to a position, before a recording, watching the force.

    Towards the finger it goes as an approach does, bounded whatever stands still. Raises ContactTooEarlyError
    where the force rises by `threshold_mn` on the way; the arm is halted then.
    """
    towards = position_mm > lever.commanded_mm
    speed_mm_s = lever.limits.approach_speed_max_mm_s if towards else POSITIONING_MM_S

    def way_mm() -> FloatArray:
        return ramp_mm(lever.commanded_mm, position_mm, speed_mm_s, lever.sample_rate_hz)

    waveform = way_mm()
    if len(waveform) < SHORTEST_WAY:
        return
    read = round(_FREE_S * lever.sample_rate_hz)
    lever.start_recording()
    free_mn = float(np.mean(lever.read(read).force_mn))
    met = Contact(ContactDetector(threshold_mn, *_MET), free_mn)
    lever.look_for_force(free_mn + threshold_mn + SKIN_MARGIN_MN)
    playback = lever.play_until(waveform, met, _MET_READ)
    while playback is not None:
        while not playback.done:
            check()
            lever.read(read)
        waveform = way_mm()
        playback = lever.go_on(waveform) if playback.starved and len(waveform) >= SHORTEST_WAY else None
    stopped_mm = lever.halt()
    if met.decided is not None:
        raise ContactTooEarlyError(
            f"the arm met something at {stopped_mm:.3f} mm on its way to {position_mm:.3f} mm: "
            "clear the way, or let the approach start earlier (surface.start_mm)"
        )
    lever.stop_recording()
