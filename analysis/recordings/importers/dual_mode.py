"""Phases of a dual-mode lever, which holds length or force, whichever limit it meets first.

The lever follows its length command until the force reaches the commanded force; then it holds that force
and the length is free. An indentation on it is a length ramp that is stopped by the skin (light contact at
the small resting force), a force ramp that presses, and their way back. Only while the length is at its
command does the lever hold position, and only then does the force relax.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.recordings.trial import Event, FloatArray, Phase, Surface

_AT_COMMAND_MM = 0.05  # recorded and commanded length agree at rest to within this
_HELD_MM = 0.005  # held: within 5 um of the level; creep under held force passes it within 5 ms
_SHORTEST_HOLD_S = 0.02
_SHORTEST_FORCE_HOLD_S = 0.005
_RINGING_SWINGS = 4


@dataclass(frozen=True, slots=True)
class Modes:
    """What was found: phases, events (changes of control mode, ringing), contact, and words for the log."""

    phases: tuple[Phase, ...]
    events: tuple[Event, ...]
    surface: Surface | None
    depth_mm: float | None
    hold_s: float | None
    log: tuple[str, ...]


def find_modes(
    position_mm: FloatArray,
    force_mn: FloatArray,
    command_mm: FloatArray,
    force_command_mn: FloatArray,
    sample_rate_hz: float,
) -> Modes:
    """Find when the lever pressed, and when in that time it held length or force; all (N,)."""
    n = len(position_mm)
    pressed = np.flatnonzero(force_command_mn > force_command_mn[0])
    if not pressed.size:
        return Modes((), (), None, None, None, ("phases: none, the force command never rises",))
    press, release = int(pressed[0]), int(pressed[-1]) + 1
    contact = _contact(position_mm, command_mm, press)
    hold = _position_held(position_mm, command_mm, press, release, sample_rate_hz)
    # what the force reads while the light resting force is commanded is the sensor's offset
    resting_mn = force_mn[contact:press] - force_command_mn[contact:press]
    missed_mn = force_mn - force_command_mn - (float(np.median(resting_mn)) if press > contact else 0.0)
    span = (press, release if hold is None else hold[0])
    forced = _force_held(missed_mn, force_command_mn, span, sample_rate_hz)
    back = _back_at_rest(command_mm, release)

    before = [Phase("approach", 0, contact), Phase("dwell", contact, press)]
    if hold is not None:
        middle = [Phase("ramp", press, hold[0]), Phase("hold", *hold), Phase("retract", hold[1], back)]
    else:
        pushed = forced[0] if forced else _peak(force_command_mn)
        leaves = forced[1] if forced else pushed
        middle = [Phase("ramp", press, pushed), Phase("retract", leaves, back)]
    phases = [p for p in (*before, *middle, Phase("clear", back, n)) if p.stop > p.start]

    events: list[Event] = []
    log = [f"phases from the commands and the motion: {', '.join(p.name for p in phases)}"]
    if forced is not None:
        level = float(np.median(force_mn[slice(*forced)]))
        crept = float(position_mm[forced[1] - 1] - position_mm[forced[0]])
        seconds = (forced[1] - forced[0]) / sample_rate_hz
        words = f"force held at {level:.1f} mN for {seconds:.3f} s, position creeps {crept:.3f} mm"
        events.append(Event(forced[0], "force_held", words))
        log.append(words)
    if hold is not None:
        level = float(np.median(position_mm[slice(*hold)]))
        words = f"position held at {level:.4f} mm from {hold[0] / sample_rate_hz:.4f} s"
        if forced is not None:
            words = f"change of control mode, from force to position: {words}"
            events.append(Event(hold[0], "control_mode", words))
        log.append(f"{words} for {(hold[1] - hold[0]) / sample_rate_hz:.4f} s")
        ringing = _ringing(position_mm, level, press, hold[0], sample_rate_hz)
        if ringing is not None:
            events.append(ringing)
            log.append(ringing.message)
        depth_mm: float | None = round(level - float(position_mm[press]), 4)
        log.append(f"depth {depth_mm} mm, measured from the end of the dwell to the hold")
    else:
        depth_mm = None
        log.append("no hold: the lever never holds position while it presses")
    surface = Surface(float(position_mm[contact]), contact, float("nan"), float("nan"))
    log.append(f"surface at {surface.position_mm:.3f} mm, where the length falls behind its command")
    return Modes(
        phases=tuple(phases),
        events=tuple(sorted(events, key=lambda event: event.sample)),
        surface=surface,
        depth_mm=depth_mm,
        hold_s=None if hold is None else (hold[1] - hold[0]) / sample_rate_hz,
        log=tuple(log),
    )


def _contact(position_mm: FloatArray, command_mm: FloatArray, press: int) -> int:
    """Return the sample at which the skin stops the lever: the length falls behind its command for good."""
    following = np.flatnonzero(position_mm[:press] >= command_mm[:press] - _AT_COMMAND_MM)
    return int(following[-1]) if following.size else 0


def _position_held(
    position_mm: FloatArray, command_mm: FloatArray, press: int, release: int, rate: float
) -> tuple[int, int] | None:
    """Return the longest stretch, start and stop, at one level close to the length command, or None."""
    x, u = position_mm[press:release], command_mm[press:release]
    near = np.abs(x - u) < _AT_COMMAND_MM
    if near.sum() < _SHORTEST_HOLD_S * rate:
        return None
    level = float(np.median(x[near]))
    runs = _runs(np.abs(x - level) <= _HELD_MM)
    start, stop = max(runs, key=lambda run: run[1] - run[0], default=(0, 0))
    return (press + start, press + stop) if stop - start >= _SHORTEST_HOLD_S * rate else None


def _force_held(
    missed_mn: FloatArray, force_command_mn: FloatArray, span: tuple[int, int], rate: float
) -> tuple[int, int] | None:
    """Return the longest stretch of the span in which the force is at the peak of its command, or None."""
    peak = float(force_command_mn.max())
    command, missed = force_command_mn[slice(*span)], missed_mn[slice(*span)]
    held = (np.abs(missed) <= 0.03 * peak + 2.0) & (command >= 0.999 * peak)
    start, stop = max(_runs(held), key=lambda run: run[1] - run[0], default=(0, 0))
    return (span[0] + start, span[0] + stop) if stop - start >= _SHORTEST_FORCE_HOLD_S * rate else None


def _peak(force_command_mn: FloatArray) -> int:
    return int(np.argmax(force_command_mn >= 0.999 * force_command_mn.max()))


def _back_at_rest(command_mm: FloatArray, release: int) -> int:
    """Return the sample at which the length command has come back to where it ends."""
    moving = np.flatnonzero(np.abs(command_mm[release:] - command_mm[-1]) > 1e-9)
    return release + int(moving[-1]) + 1 if moving.size else release


def _ringing(position_mm: FloatArray, level: float, press: int, stop: int, rate: float) -> Event | None:
    """Return an event where the lever swings about its stop before it stands still."""
    arrived = np.flatnonzero(position_mm[press:stop] >= level)
    if not arrived.size:
        return None
    first = press + int(arrived[0])
    swing = position_mm[first:stop] - level
    beyond = swing[np.abs(swing) > _HELD_MM]
    turns = int(np.count_nonzero(np.diff(np.sign(beyond))))
    if turns < _RINGING_SWINGS:
        return None
    crossings = np.flatnonzero(np.diff(np.sign(swing)))
    frequency = (len(crossings) - 1) / 2 / ((crossings[-1] - crossings[0]) / rate)
    amplitude_um = 1e3 * float(np.abs(swing).max())
    words = f"ringing at the stop: about {frequency:.0f} Hz, {amplitude_um:.0f} um, {len(swing) / rate:.3f} s"
    return Event(first, "ringing", words)


def _runs(flags: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> list[tuple[int, int]]:
    """Return start and stop of every stretch of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
