"""The guard's own process: waits for the program's death and then moves the arm to the safe position.

On stdin: one JSON line of orders, then words, one a line: "beat", "away", "safe", "end". A pipe that
closes without "end", a parent that is gone, or a heartbeat that stops while the arm is away mean
that nobody else will move it. `reset_device()` would not: an S Series output keeps its voltage.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import queue
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from analysis.recordings.trial import Calibration
from rig.hardware.daq import Card
from rig.hardware.errors import CardBusyError, HardwareError
from rig.hardware.retreat import Retreat, bring_to_safety
from rig.settings.rig_file import CardSettings, GuardSettings, LeverSettings

_log = logging.getLogger("guard")

_LOOK_S = 0.02
"""How often the parent is looked at, beside the pipe."""

_TRIES_S = 10.0
"""How long the card is asked for before the guard gives up."""

_RETRY_S = 0.02


def main() -> int:
    """Run the guard; 0 after an orderly end or a successful retreat, 1 where the arm could not be moved."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(OSError, AttributeError):
        os.nice(-10)  # where it is allowed: it must not wait behind whatever keeps the computer busy
    orders = json.loads(sys.stdin.buffer.readline())
    card_settings = CardSettings.model_validate_json(json.dumps(orders["rig"]["card"]))
    lever = LeverSettings.model_validate_json(json.dumps(orders["rig"]["lever"]))
    settings = GuardSettings.model_validate_json(json.dumps(orders["rig"]["guard"]))
    calibration = Calibration(**orders["calibration"])
    _log_to(settings.log_file)
    with Card(orders["card_address"], card_settings.device) as card:
        card.connect()
        words: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        threading.Thread(target=_listen, args=(sys.stdin.buffer, words), daemon=True).start()
        print("ready", flush=True)
        return _watch(
            words,
            program=orders["program"],
            heartbeat_timeout_s=settings.heartbeat_timeout_s,
            to_safety=lambda: bring_to_safety(card, card_settings, lever, calibration),
            free=card.clear_left_over_tasks,
        )


def _listen(pipe: BinaryIO, words: queue.SimpleQueue[str | None]) -> None:
    """Put the program's words into the queue, and None at the end of the pipe."""
    for line in pipe:
        words.put(line.decode().strip())
    words.put(None)


def _watch(
    words: queue.SimpleQueue[str | None],
    *,
    program: int,
    heartbeat_timeout_s: float,
    to_safety: Callable[[], Retreat],
    free: Callable[[], None],
) -> int:
    away = False
    heard_s = time.monotonic()
    parent = os.getppid()
    while True:
        try:
            word = words.get(timeout=_LOOK_S)
        except queue.Empty:
            # the pipe stays open while any process forked by the program lives
            dead = os.getppid() != parent
        else:
            heard_s = time.monotonic()
            dead = word is None
            if word == "end":
                return 0
            if word in {"away", "safe"}:
                away = word == "away"
        if dead and not away:
            _log.info("the program is gone, the arm is safe: freeing the card")
            free()
            return 0
        if dead:
            return _move("the program is gone", to_safety, program=None)
        if away and time.monotonic() - heard_s > heartbeat_timeout_s:
            _move(f"no sign of life for {heartbeat_timeout_s:g} s", to_safety, program=program)
            away = False


def _move(why: str, to_safety: Callable[[], Retreat], *, program: int | None) -> int:
    """Bring the arm to safety, trying while the card is still held; 0 when it is there."""
    began_s = time.monotonic()
    _log.warning("%s and the arm is not safe: taking the card", why)
    while True:
        try:
            done = to_safety()
        except HardwareError as error:
            spent_s = time.monotonic() - began_s
            _log.warning("after %.3f s: %s", spent_s, error)
            if spent_s > _TRIES_S:
                _log.error("the arm could not be moved; lift it by hand")
                return 1
            if isinstance(error, CardBusyError) and program is not None:
                # a program that is silent and holds the card keeps the arm where it is: it must go
                _log.warning("ending the silent program, process %d", program)
                with contextlib.suppress(ProcessLookupError):
                    os.kill(program, signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL)
                program = None
            time.sleep(_RETRY_S)
        else:
            _log.warning(
                "arm moved from %.3f to %.3f mm, %.3f s after the alarm",
                done.from_mm,
                done.to_mm,
                time.monotonic() - began_s,
            )
            return 0


def _log_to(file: str | None) -> None:
    from platformdirs import user_log_path

    path = Path(file) if file is not None else user_log_path("indenter", ensure_exists=True) / "guard.log"
    logging.basicConfig(
        filename=path, level=logging.INFO, format="%(asctime)s.%(msecs)03d %(message)s", datefmt="%F %T"
    )


if __name__ == "__main__":
    sys.exit(main())
