"""The way to the safe position when only the card is known: see where the arm is, move slew-limited, look."""

from __future__ import annotations

import contextlib
import logging
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import Calibration
from rig.hardware.daq import Card, CardInput
from rig.hardware.errors import RetreatFailedError, SamplesLateError, SamplesLostError
from rig.settings.rig_file import CardSettings, LeverSettings

FloatArray = NDArray[np.float64]

_log = logging.getLogger(__name__)

_TRIES = 3

LOOK_S = 0.005
"""How long the inputs are averaged to see where the arm is."""

SETTLE_S = 0.01
"""How long the arm is given to follow the last sample of a motion (a servo of 5e3 rad/s takes 1.3 ms)."""

LATE_S = 5.0
"""How much longer than expected the card may take: a computer that is busy starts an output late."""

_BEARINGS_MARGIN_V = 0.05
"""A loop-back that far outside what was told is not wired to the output, or broken."""

_CONFIRMED_MM = 0.1
"""An arm that has moved so far towards safety is on its way, whatever its force signal says."""

_RISE_AWAY_MN = 20.0
_RISE_TOWARDS_MN = 10.0
"""Force that a retreat may add: on the way from the finger none is expected, and still less on one towards it."""


@dataclass(frozen=True)
class Bearings:
    """What whoever moved the arm last knew of its output, V: where it may be, and where the arm was found clear."""

    low_v: float
    high_v: float
    safe_v: float


@dataclass(frozen=True)
class Retreat:
    """What a retreat found and did: where the arm was and where it came to rest, mm."""

    from_mm: float
    to_mm: float
    duration_s: float


class RetreatWatch:
    """Tells a way to safety that presses instead: force and position must not both speak against it.

    ``seen``: samples (n_channels, n), V, just before it; ``by_v``: where the output goes, V from where it is.
    """

    def __init__(self, seen: FloatArray, by_v: float, calibration: Calibration) -> None:
        self._calibration = calibration
        self._start_mm, self._start_mn = self._felt(seen)
        self._by_mm = by_v / calibration.command_volts_per_mm

    def check(self, block: FloatArray) -> None:
        """Look at the next samples; RetreatFailedError where the arm is driven into something."""
        position_mm, force_mn = self._felt(block)
        rise_mn = force_mn - self._start_mn
        moved_mm = position_mm - self._start_mm
        confirmed = self._by_mm < 0 and moved_mm < -_CONFIRMED_MM
        if not confirmed and rise_mn > (_RISE_AWAY_MN if self._by_mm < 0 else _RISE_TOWARDS_MN):
            raise RetreatFailedError(
                f"the force rose by {rise_mn:.0f} mN on the way to safety while the arm moved by "
                f"{moved_mm:+.2f} mm: it was stopped; lift it by hand"
            )

    def _felt(self, block: FloatArray) -> tuple[float, float]:
        c = self._calibration
        position_v, force_v = float(block[0].mean()), float(block[1].mean())
        return (position_v - c.position_zero_v) / c.volts_per_mm, (force_v - c.force_zero_v) / c.volts_per_mn


def straight_mm(from_mm: float, to_mm: float, *, speed_mm_s: float, rate_hz: float) -> FloatArray:
    """A straight way at one speed, from the first to the last value, one value a sample, mm."""
    n = max(math.ceil(abs(to_mm - from_mm) / speed_mm_s * rate_hz), 1)
    return np.linspace(from_mm, to_mm, n + 1)


def way_to_safety_v(
    from_v: float, safe_v: float, calibration: Calibration, lever: LeverSettings, card: CardSettings
) -> FloatArray:
    """A straight way of the output at the retreat's speed, one value a sample, V; it begins where the output is."""
    speed_v_s = lever.retreat_speed_mm_s * abs(calibration.command_volts_per_mm)
    volts: FloatArray = np.clip(
        straight_mm(from_v, safe_v, speed_mm_s=speed_v_s, rate_hz=card.sample_rate_hz),
        -card.range_v,
        card.range_v,
    )
    return volts


def output_now_v(
    seen: FloatArray,
    calibration: Calibration,
    lever: LeverSettings,
    *,
    loopback_wired: bool,
    bearings: Bearings | None,
) -> float:
    """What the output holds, V, from samples (n_channels, n); RetreatFailedError where that can't be known.

    The loop-back reads it without any constant. One that contradicts what was told, or the position where
    nothing was told, is not believed: to begin anywhere else would make the arm jump.
    """
    c = calibration
    position_mm = (float(seen[0].mean()) - c.position_zero_v) / c.volts_per_mm
    by_position_v = position_mm * c.command_volts_per_mm + c.command_zero_v
    loopback_v = float(seen[2].mean()) if loopback_wired else None
    if bearings is not None:
        low_v, high_v = bearings.low_v - _BEARINGS_MARGIN_V, bearings.high_v + _BEARINGS_MARGIN_V
        if loopback_v is not None and low_v <= loopback_v <= high_v:
            return loopback_v
        return min(max(by_position_v, bearings.low_v), bearings.high_v)
    if loopback_v is None:
        return by_position_v
    loopback_mm = (loopback_v - c.command_zero_v) / c.command_volts_per_mm
    if abs(loopback_mm - position_mm) > lever.following_error_max_mm:
        raise RetreatFailedError(
            f"the loop-back says {loopback_mm:.2f} mm and the position signal {position_mm:.2f} mm, so nobody knows "
            "where the arm is commanded to; lift it by hand, then check power and wires of the lever"
        )
    return loopback_v


def bring_to_safety(
    card: Card,
    settings: CardSettings,
    lever: LeverSettings,
    calibration: Calibration,
    bearings: Bearings | None = None,
    alive: Callable[[], None] = lambda: None,
) -> Retreat:
    """Move the arm to the safe position with tasks of its own; the card must be free or left by the dead.

    ``alive`` is called again and again meanwhile. Raises CardError where the card refuses, RetreatFailedError
    where the arm does not follow. A computer too busy to read is no reason to leave the arm where it is: the
    move is then begun again.
    """
    for _ in range(_TRIES - 1):
        try:
            return _bring_to_safety(card, settings, lever, calibration, bearings, alive)
        except (SamplesLostError, SamplesLateError) as error:
            _log.warning("retreat begun again: %s", error)
    return _bring_to_safety(card, settings, lever, calibration, bearings, alive)


def _bring_to_safety(
    card: Card,
    settings: CardSettings,
    lever: LeverSettings,
    calibration: Calibration,
    bearings: Bearings | None,
    alive: Callable[[], None],
) -> Retreat:
    c, rate_hz = calibration, settings.sample_rate_hz
    card.clear_left_over_tasks()
    inputs = [settings.position_channel, settings.force_channel]
    inputs += [settings.loopback_channel] if settings.loopback_channel else []
    source = card.open_input(
        inputs,
        rate_hz=rate_hz,
        range_v=settings.range_v,
        buffer_samples=round(settings.input_buffer_s * rate_hz),
    )
    with contextlib.closing(source):
        source.start()
        seen = source.read(round(LOOK_S * rate_hz), timeout_s=LATE_S).copy()
        alive()
        from_v = output_now_v(
            seen, c, lever, loopback_wired=settings.loopback_channel is not None, bearings=bearings
        )
        safe_mm = lever.safe_position_mm
        safe_v = safe_mm * c.command_volts_per_mm + c.command_zero_v if bearings is None else bearings.safe_v
        way_v = way_to_safety_v(from_v, safe_v, c, lever, settings)
        watch = RetreatWatch(seen, safe_v - from_v, c)
        last = _drive(card, source, way_v, settings, watch, alive)
    to_mm = (float(last[0].mean()) - c.position_zero_v) / c.volts_per_mm
    if abs(to_mm - safe_mm) > lever.following_error_max_mm:
        raise RetreatFailedError(
            f"the arm is at {to_mm:.2f} mm instead of the safe {safe_mm:g} mm; lift it by hand, then check the "
            "lever's power"
        )
    from_mm = (float(seen[0].mean()) - c.position_zero_v) / c.volts_per_mm
    return Retreat(from_mm, to_mm, len(way_v) / rate_hz)


def _drive(
    card: Card,
    source: CardInput,
    volts: FloatArray,
    settings: CardSettings,
    watch: RetreatWatch,
    alive: Callable[[], None],
) -> FloatArray:
    """Play the volts while reading, until they are out and the arm has settled; the last samples read."""
    rate_hz = settings.sample_rate_hz
    n_read = n_look = round(LOOK_S * rate_hz)
    output = card.open_output(settings.command_channel, volts, rate_hz=rate_hz, range_v=settings.range_v)
    with contextlib.closing(output):
        started = source.acquired()
        output.start()
        # what was sampled while the output was prepared is read as well, up to the end of the way
        stop = started + len(volts) + round(SETTLE_S * rate_hz)
        patience = stop + round(LATE_S * rate_hz)
        while True:
            if n_read > patience:
                raise RetreatFailedError("the output of the card does not end; lift the arm by hand")
            seen = source.read(n_look, timeout_s=LATE_S)
            alive()
            watch.check(seen)
            n_read += n_look
            if n_read >= stop and output.done():
                return seen
