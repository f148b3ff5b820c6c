"""The motorised Z stage under the block, in Zaber's ASCII protocol (firmware 7): one linear axis, address 01.

Commands: `home`, `move abs|rel|min|max`, `stop`, `get pos|maxspeed|limit.min|limit.max|resolution|
deviceid|system.serial|version`, `set maxspeed`, and the empty command that asks for the status.
A message id (a number before the command) comes back in the reply.
"""

import re
from collections.abc import Callable

MICROSTEP_UM = 0.047625
TRAVEL_MICROSTEPS = 533_333  # 25.4 mm
SPEED_UNIT_MICROSTEPS_S = 1 / 1.6384
DEFAULT_SPEED = 68_000  # about 2 mm/s
_LINE = re.compile(r"/\s*(?P<numbers>(?:\d+\s*){0,3})(?P<command>[a-z].*)?$")


class _RejectedError(Exception):
    """A command that the axis rejects; the message is the protocol's reason."""


class Stage:
    """Position along the axis follows the bench's clock; `moved` hears of each target in micrometres."""

    def __init__(self, time_s: Callable[[], float], moved: Callable[[float], object]) -> None:
        self._time_s = time_s
        self._moved = moved
        self._homed = False
        self._speed = DEFAULT_SPEED
        self._start, self._target = 0.0, 0.0
        self._start_s, self._end_s = 0.0, 0.0

    @property
    def _busy(self) -> bool:
        return self._time_s() < self._end_s

    @property
    def _position(self) -> float:
        """Where the carriage is now, microsteps."""
        now_s = self._time_s()
        if now_s >= self._end_s:
            return self._target
        share = (now_s - self._start_s) / (self._end_s - self._start_s)
        return self._start + share * (self._target - self._start)

    def _go(self, target: float) -> None:
        self._start, self._target = self._position, target
        self._start_s = self._time_s()
        speed_microsteps_s = self._speed * SPEED_UNIT_MICROSTEPS_S
        self._end_s = self._start_s + abs(self._target - self._start) / speed_microsteps_s
        self._moved(target * MICROSTEP_UM)

    def answer(self, line: str) -> list[str]:
        """The reply to one command line; silence for lines to other devices, as on a chain."""
        match = _LINE.match(line)
        if match is None:
            return []
        numbers = [int(number) for number in match["numbers"].split()]
        device, axis = [*numbers, 0, 0][:2]
        if device not in {0, 1} or len(numbers) > 3:
            return []
        message_id = f"{numbers[2]:02d} " if len(numbers) == 3 else ""
        try:
            flag, data = "OK", self._execute(axis, (match["command"] or "").split())
        except _RejectedError as rejected:
            flag, data = "RJ", str(rejected)
        status = "BUSY" if self._busy else "IDLE"
        warning = "--" if self._homed else "WR"
        return [f"@01 {axis} {message_id}{flag} {status} {warning} {data}"]

    def _execute(self, axis: int, words: list[str]) -> str:
        """Do one command; the data of its reply."""
        if axis not in {0, 1}:
            raise _RejectedError("BADAXIS")
        match words:
            case []:
                pass
            case ["home"]:
                self._homed = True
                self._go(0.0)
            case ["stop"]:
                self._go(self._position)
            case ["move", *where]:
                self._move(where)
            case ["set", "maxspeed", number]:
                if not re.fullmatch(r"[1-9]\d*", number):
                    raise _RejectedError("BADDATA")
                self._speed = int(number)
            case ["get", name]:
                return self._get(name)
            case _:
                raise _RejectedError("BADCOMMAND")
        return "0"

    def _move(self, where: list[str]) -> None:
        """Go somewhere; refused outside the travel, and before the first `home` (no reference position)."""
        match where:
            case ["min"]:
                target = 0
            case ["max"]:
                target = TRAVEL_MICROSTEPS
            case ["abs" | "rel" as kind, number] if re.fullmatch(r"-?\d+", number):
                target = int(number) + (round(self._position) if kind == "rel" else 0)
            case ["abs" | "rel", *_]:
                raise _RejectedError("BADDATA")
            case _:
                raise _RejectedError("BADCOMMAND")
        if not self._homed or not 0 <= target <= TRAVEL_MICROSTEPS:
            raise _RejectedError("BADDATA")
        self._go(float(target))

    def _get(self, name: str) -> str:
        values = {
            "pos": str(round(self._position)),
            "maxspeed": str(self._speed),
            "limit.min": "0",
            "limit.max": str(TRAVEL_MICROSTEPS),
            "resolution": "64",
            "deviceid": "50105",
            "system.serial": "10001",
            "version": "7.38",
        }
        if name not in values:
            raise _RejectedError("BADCOMMAND")
        return values[name]
