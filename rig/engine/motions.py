"""How each motion of a trial is done: waveforms played, samples taken, what they show acted upon."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from analysis.recordings.trial import FloatArray, Surface
from rig.engine.errors import ContactLostError, OvershotError, SurfaceNotFoundError
from rig.engine.positioning import SHORTEST_WAY, Contact
from rig.engine.recorder import Recorder
from rig.engine.states import State
from rig.hardware.lever import Lever, Playback
from rig.protocols.contact import ContactDetector, LeavingDetector, ReleaseDetector, locate_crossing
from rig.protocols.indenting import FREE_S
from rig.protocols.steps import Approach, Motion, RampTo, Retract, Stay, Sweep
from rig.protocols.waveforms import ramp_mm, there_and_back_mm

_SWEEP_MARGIN_MN = 50.0
"""Force above that of the free arm in an air sweep that no friction, weight or inertia of the arm adds."""

_SETTLE_S = 0.01
"""After a stop the servo comes to rest within 2 ms; so long is its position averaged."""

_RETRACT_READ_S = 0.01

_STATES = {"approach": State.APPROACHING, "dwell": State.DWELLING, "hold": State.HOLDING}


@dataclass(frozen=True, slots=True)
class _Free:
    """What the sensors say of the free arm: force, mN."""

    force_mn: float
    noise_mn: float


class TrialMotions:
    """Does the motions of one trial, one after the other; each begins where the one before ended.

    `enter` is told the state that each motion is in, `say` what was found. `surface` is what the approach
    found.
    """

    def __init__(
        self,
        lever: Lever,
        recorder: Recorder,
        *,
        enter: Callable[[State], None],
        say: Callable[[str], None],
    ) -> None:
        self._lever = lever
        self._recorder = recorder
        self._enter = enter
        self._say = say
        self._free = _Free(0.0, 0.0)
        self._still_since = 0
        self.surface: Surface | None = None

    def do(self, motion: Motion) -> None:
        """Do one motion. Raises RigError where it can't be finished."""
        match motion:
            case Approach():
                self._approach(motion)
            case Stay():
                self._stay(motion)
            case RampTo():
                self._ramp(motion)
            case Retract():
                self._retract(motion)
            case Sweep():
                self._sweep(motion)

    def _approach(self, step: Approach) -> None:
        self._enter(State.APPROACHING)
        lever, recorder = self._lever, self._recorder
        recorder.begin_phase("approach", 0)
        recorder.take_for(FREE_S)
        self._free = _Free(float(np.mean(recorder.force_mn)), float(np.std(recorder.force_mn)))
        first = recorder.n
        threshold_mn = step.threshold_mn
        if step.threshold_v is not None:
            threshold_mn = step.threshold_v / abs(lever.calibration.volts_per_mn)
        threshold = f"{threshold_mn:.4g} mN = {threshold_mn * abs(lever.calibration.volts_per_mn):.4g} V"
        free = f"the free arm's {self._free.force_mn:.4g} mN"
        recorder.note(first, "threshold", f"contact at {threshold} above {free}")
        detector = ContactDetector(threshold_mn, step.samples_above, step.samples_watched)
        contact = Contact(detector, self._free.force_mn)
        if step.force_margin_mn is not None:
            lever.look_for_force(self._free.force_mn + threshold_mn + step.force_margin_mn)
        stop = self._until_contact(step, contact)
        if stop is None or contact.decided is None:
            raise SurfaceNotFoundError(
                f"no contact of {threshold_mn:.3g} mN up to the travel limit of "
                f"{lever.limits.travel_max_mm:g} mm: raise the finger, or lower contact_threshold_mn"
            )
        # what the card took before it was stopped shows the way there: only what follows is at rest
        recorder.take_until(max(recorder.n, lever.acquired))
        self._contact(first, contact.decided, threshold_mn)
        self._still_since = stop
        assert self.surface is not None
        lever.look_for_force(None)
        lever.surface_found(self.surface.position_mm)
        self._refuse_overshoot(self.surface)
        found = f"surface at {self.surface.position_mm:.4f} mm, overshoot {self.surface.overshoot_um:.1f} um"
        recorder.note(stop, "contact", found)
        self._say(f"{found} (threshold {threshold})")

    def _until_contact(self, step: Approach, contact: Contact) -> int | None:
        """Approach until contact; the sample at which the arm stopped, None at the end of the travel.

        An output that ran dry on the way, since the computer or the card's server stood still, stopped the
        arm in the air: it goes on from there once every sample taken meanwhile has been looked at.
        """
        lever, recorder = self._lever, self._recorder
        start_mm, waveform = self._way(step)
        playback = lever.play_until(waveform, contact, step.samples_per_read)
        while playback is not None:
            recorder.take_while_playing(playback)
            if not playback.starved:
                stopped_mm = lever.halt()
                return recorder.started(playback) + _played(waveform, start_mm, stopped_mm)
            recorder.note(
                recorder.n,
                "paused",
                f"the output ran dry and the arm stopped by itself at {lever.commanded_mm:.3f} mm",
            )
            start_mm, waveform = self._way(step)
            playback = lever.go_on(waveform) if len(waveform) >= SHORTEST_WAY else None
        lever.halt()
        return contact.decided

    def _way(self, step: Approach) -> tuple[float, FloatArray]:
        """From where the arm is commanded to be, mm, to the end of the travel."""
        start_mm, limits = self._lever.commanded_mm, self._lever.limits
        return start_mm, ramp_mm(start_mm, limits.travel_max_mm, step.speed_mm_s, self._lever.sample_rate_hz)

    def _contact(self, first: int, decided: int, threshold_mn: float) -> None:
        """Work out where contact was, from the rise up to the deciding sample, and the overshoot."""
        recorder = self._recorder
        rise = slice(first, decided + 1)
        crossing = locate_crossing(
            recorder.position_mm[rise], recorder.force_mn[rise] - self._free.force_mn, threshold_mn
        )
        recorder.take_for(_SETTLE_S)
        before_rest = recorder.n
        recorder.take_for(_SETTLE_S)
        rest_mm = float(np.mean(recorder.position_mm[before_rest:]))
        self.surface = Surface(
            position_mm=crossing.position,
            sample=first + round(crossing.sample),
            overshoot_um=1e3 * (rest_mm - crossing.position),
            threshold_mn=threshold_mn,
        )
        recorder.surface(self.surface)

    def _refuse_overshoot(self, surface: Surface) -> None:
        most_um = self._lever.limits.overshoot_max_um
        if surface.overshoot_um > most_um:
            raise OvershotError(
                f"the surface at {surface.position_mm:.3f} mm was overshot by {surface.overshoot_um:.0f} um, more than "
                f"lever.overshoot_max_um = {most_um:g}: approach more slowly, close other programs, run again"
            )

    def _stay(self, step: Stay) -> None:
        recorder = self._recorder
        if step.phase in _STATES:
            self._enter(_STATES[step.phase])
        recorder.begin_phase(step.phase, self._still_since)
        self._still_since += round(step.duration_s * self._lever.sample_rate_hz)
        if step.phase == "hold" and self.surface is not None:
            self._hold_until(self._still_since, self.surface)
        recorder.take_until(self._still_since)
        recorder.end_phase(self._still_since)

    def _hold_until(self, stop: int, surface: Surface) -> None:
        """Record up to a sample while the finger stays; ContactLostError as soon as it has left the punch."""
        recorder = self._recorder
        leaving = LeavingDetector(self._free.force_mn, surface.threshold_mn)
        while recorder.n < stop:
            chunk = recorder.take(min(recorder.read_samples, stop - recorder.n))
            if leaving.feed(chunk.force_mn):
                raise ContactLostError(
                    f"the finger left the punch in the hold, {(stop - recorder.n) / self._lever.sample_rate_hz:.1f} s "
                    "before its end: the force is that of the free arm; place the finger again, run again"
                )

    def _ramp(self, step: RampTo) -> None:
        self._enter(State.RAMPING)
        assert self.surface is not None, "a ramp needs a surface"
        lever = self._lever
        start_mm = lever.commanded_mm
        target_mm = start_mm + step.depth_mm - self.surface.overshoot_um / 1e3
        if target_mm <= start_mm:
            raise OvershotError(
                f"the surface was overshot by {self.surface.overshoot_um:.1f} um, deeper than the depth of "
                f"{1e3 * step.depth_mm:g} um that was asked for: approach more slowly, run again"
            )
        waveform = ramp_mm(start_mm, target_mm, step.speed_mm_s, lever.sample_rate_hz)
        self._still_since = self._play_whole("ramp", waveform)

    def _retract(self, step: Retract) -> None:
        self._enter(State.RETRACTING)
        assert self.surface is not None, "a retract needs a surface"
        lever, recorder = self._lever, self._recorder
        start_mm = lever.commanded_mm
        end_mm = max(lever.limits.travel_min_mm, self.surface.position_mm - step.max_mm)
        waveform = ramp_mm(start_mm, end_mm, step.speed_mm_s, lever.sample_rate_hz)
        # the moving arm's friction and drift since the approach move its zero; contact is judged loosely
        tolerance_mn = max(0.5 * self.surface.threshold_mn, 4 * self._free.noise_mn)
        release = ReleaseDetector(self._free.force_mn, self.surface.position_mm, tolerance_mn)
        playback = lever.play(waveform)
        begun = recorder.started(playback)
        recorder.begin_phase("retract", begun)
        recorder.take_until(max(recorder.n, begun))
        read = round(_RETRACT_READ_S * lever.sample_rate_hz)
        lost = False
        while not lost and not playback.done:
            chunk = recorder.take(read)
            lost = release.feed(chunk.position_mm, chunk.force_mn)
        if lost and not playback.done:
            end_mm = lever.halt()
        if not lost:
            recorder.note(
                recorder.n,
                "contact_not_lost",
                f"the force was not back at that of the free arm {step.max_mm:g} mm above the surface",
            )
        self._still_since = begun + _played(waveform, start_mm, end_mm)
        self._enter(State.CLEARING)
        recorder.take_until(self._still_since)

    def _sweep(self, step: Sweep) -> None:
        self._enter(State.SWEEPING)
        lever, recorder = self._lever, self._recorder
        recorder.take_for(_SETTLE_S)
        lever.look_for_force(float(np.mean(recorder.force_mn)) + _SWEEP_MARGIN_MN)
        out_and_back = there_and_back_mm(step.from_mm, step.to_mm, step.speed_mm_s, lever.sample_rate_hz)
        end = self._play_whole("sweep", out_and_back)
        recorder.end_phase(end)
        recorder.take_for(_SETTLE_S)

    def _play_whole(self, phase: str, waveform: FloatArray) -> int:
        """Play a waveform to its end as a phase; return the sample at which it ended."""
        recorder = self._recorder
        if not len(waveform):
            recorder.begin_phase(phase, recorder.n)
            return recorder.n
        playback: Playback = self._lever.play(waveform)
        begun = recorder.started(playback)
        recorder.begin_phase(phase, begun)
        recorder.take_until(begun + playback.n)
        return begun + playback.n


def _played(waveform: FloatArray, start_mm: float, stopped_mm: float) -> int:
    """Return how many samples of a straight ramp were played when it stopped at `stopped_mm`."""
    share = (stopped_mm - start_mm) / (waveform[-1] - start_mm)
    return int(np.clip(round(share * len(waveform)), 0, len(waveform)))
