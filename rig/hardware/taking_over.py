"""What a guard does where nobody else moves the arm: it takes the card, and tells the person where that takes time."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from analysis.recordings.trial import Calibration
from rig.hardware.daq import Card
from rig.hardware.errors import CardBusyError, HardwareError, RetreatFailedError
from rig.hardware.retreat import Bearings, Retreat, bring_to_safety
from rig.hardware.sentinel import tell_sentinel
from rig.hardware.telling import tell_person
from rig.settings.rig_file import CardSettings, LeverSettings

_log = logging.getLogger("guard")

_TRIES_S = 10.0
"""How long the card is asked for before the guard gives up."""

_DISOBEYED_S = 1.0
"""An arm that was sent to safety and is not there is asked again for so long."""

_RETRY_S = 0.02

_TELL_S = 0.3
_TELL_LATEST_S = 0.95
"""An arm that is not clear so long after the alarm, or after the last sign of life, is the person's to lift."""

ToSafety = Callable[[Bearings | None], Retreat]


def card_of(orders: dict[str, Any]) -> Card:
    """The card, as ordered."""
    settings = CardSettings.model_validate_json(json.dumps(orders["rig"]["card"]))
    return Card(orders["card_address"], settings.device, tls=settings.tls)


def to_safety_with(card: Card, orders: dict[str, Any]) -> ToSafety:
    """What brings the arm to safety by this card, as ordered."""
    settings = CardSettings.model_validate_json(json.dumps(orders["rig"]["card"]))
    lever = LeverSettings.model_validate_json(json.dumps(orders["rig"]["lever"]))
    calibration = Calibration(**orders["calibration"])
    return lambda bearings: bring_to_safety(card, settings, lever, calibration, bearings)


def move(
    why: str,
    to_safety: ToSafety,
    bearings: Bearings | None,
    *,
    program: int | None,
    tell_fd: int | None,
    sentinel_fd: int | None,
    silent_s: float = 0.0,
    told: bool = False,
) -> int:
    """Bring the arm to safety, trying while the card is still held; 0 when it is there.

    ``program``: a process to be ended where it holds the card. A person is told where it takes time, ``silent_s``
    having passed before the alarm; with ``told`` that has been done.
    """
    began_s = time.monotonic()
    _log.warning("%s and the arm is not safe: taking the card", why)
    tell_s = 0.0 if told else max(min(_TELL_S, _TELL_LATEST_S - silent_s), 0.0)
    telling = threading.Timer(
        tell_s, tell_person, (tell_fd, f"{why} and the arm is not clear yet: LIFT IT BY HAND")
    )
    telling.daemon = True
    if not told:
        telling.start()
    while True:
        try:
            done = to_safety(bearings)
        except HardwareError as error:
            spent_s = time.monotonic() - began_s
            _log.warning("after %.3f s: %s", spent_s, error)
            if spent_s > (_DISOBEYED_S if isinstance(error, RetreatFailedError) else _TRIES_S):
                _log.error("the arm could not be moved; lift it by hand")
                telling.cancel()
                tell_person(tell_fd, f"the arm could not be moved away, LIFT IT BY HAND: {error}")
                return 1
            if isinstance(error, CardBusyError) and program is not None:
                # a program that is silent and holds the card keeps the arm where it is: it must go
                _log.warning("ending the silent program, process %d", program)
                with contextlib.suppress(ProcessLookupError):
                    os.kill(program, signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL)
                program = None
            time.sleep(_RETRY_S)
        else:
            telling.cancel()
            tell_sentinel(sentinel_fd, "safe")
            spent_s = time.monotonic() - began_s
            _log.warning(
                "arm moved from %.3f to %.3f mm, %.3f s after the alarm", done.from_mm, done.to_mm, spent_s
            )
            if spent_s > tell_s:
                tell_person(tell_fd, "the arm is clear")
            return 0
