"""The way to the safe position when only the card is known: see where the arm is, move slew-limited."""

from __future__ import annotations

import contextlib
import logging
import math
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


@dataclass(frozen=True)
class Retreat:
    """What a retreat found and did: where the arm was and where it came to rest, mm."""

    from_mm: float
    to_mm: float
    duration_s: float


def straight_mm(from_mm: float, to_mm: float, *, speed_mm_s: float, rate_hz: float) -> FloatArray:
    """A straight way at one speed, from the first to the last value, one value a sample, mm."""
    n = max(math.ceil(abs(to_mm - from_mm) / speed_mm_s * rate_hz), 1)
    return np.linspace(from_mm, to_mm, n + 1)


def bring_to_safety(
    card: Card, settings: CardSettings, lever: LeverSettings, calibration: Calibration
) -> Retreat:
    """Move the arm to the safe position with tasks of its own; the card must be free or left by the dead.

    Raises CardError where the card refuses, RetreatFailedError where the arm does not follow. A computer
    too busy to read is no reason to leave the arm where it is: the move is then begun again.
    """
    for _ in range(_TRIES - 1):
        try:
            return _bring_to_safety(card, settings, lever, calibration)
        except (SamplesLostError, SamplesLateError) as error:
            _log.warning("retreat begun again: %s", error)
    return _bring_to_safety(card, settings, lever, calibration)


def _bring_to_safety(
    card: Card, settings: CardSettings, lever: LeverSettings, calibration: Calibration
) -> Retreat:
    c, rate_hz = calibration, settings.sample_rate_hz
    card.clear_left_over_tasks()
    inputs = [settings.position_channel]
    inputs += [settings.loopback_channel] if settings.loopback_channel else [settings.force_channel]
    source = card.open_input(
        inputs,
        rate_hz=rate_hz,
        range_v=settings.range_v,
        buffer_samples=round(settings.input_buffer_s * rate_hz),
    )
    with contextlib.closing(source):
        source.start()
        n_look = round(LOOK_S * rate_hz)
        seen = source.read(n_look, timeout_s=LATE_S).mean(axis=1)
        position_mm = (float(seen[0]) - c.position_zero_v) / c.volts_per_mm
        commanded_mm = position_mm
        if settings.loopback_channel:
            commanded_mm = commanded_by_loopback_mm(float(seen[1]), position_mm, c, lever)
        way_mm = straight_mm(
            commanded_mm, lever.safe_position_mm, speed_mm_s=lever.retreat_speed_mm_s, rate_hz=rate_hz
        )
        to_mm = _drive(card, source, _volts(way_mm, c, settings.range_v), settings, c)
    if abs(to_mm - lever.safe_position_mm) > lever.following_error_max_mm:
        raise RetreatFailedError(
            f"the arm is at {to_mm:.2f} mm instead of the safe {lever.safe_position_mm:g} mm; lift it by "
            "hand, then check the lever's power"
        )
    return Retreat(position_mm, to_mm, len(way_mm) / rate_hz)


def commanded_by_loopback_mm(
    loopback_v: float, position_mm: float, calibration: Calibration, lever: LeverSettings
) -> float:
    """Where the arm is commanded to be, mm, from the loop-back; from the position where the two disagree.

    A loop-back that is declared and not wired reads anything; to begin there would make the arm jump.
    """
    c = calibration
    loopback_mm = (loopback_v - c.command_zero_v) / c.command_volts_per_mm
    return loopback_mm if abs(loopback_mm - position_mm) <= lever.following_error_max_mm else position_mm


def _volts(way_mm: FloatArray, c: Calibration, range_v: float) -> FloatArray:
    volts: FloatArray = np.clip(way_mm * c.command_volts_per_mm + c.command_zero_v, -range_v, range_v)
    return volts


def _drive(card: Card, source: CardInput, volts: FloatArray, settings: CardSettings, c: Calibration) -> float:
    """Play the volts while reading, until they are out and the arm has settled; where it then is, mm."""
    rate_hz = settings.sample_rate_hz
    n_read = n_look = round(LOOK_S * rate_hz)
    output = card.open_output(settings.command_channel, volts, rate_hz=rate_hz, range_v=settings.range_v)
    with contextlib.closing(output):
        started = source.acquired()
        output.start()
        # what was sampled while the output was prepared is read as well, up to the end of the way
        stop = started + len(volts) + round(SETTLE_S * rate_hz)
        patience = stop + round(LATE_S * rate_hz)
        position_v = float("nan")
        while n_read < stop or not output.done():
            if n_read > patience:
                raise RetreatFailedError("the output of the card does not end; lift the arm by hand")
            position_v = float(source.read(n_look, timeout_s=LATE_S)[0].mean())
            n_read += n_look
    return (position_v - c.position_zero_v) / c.volts_per_mm
