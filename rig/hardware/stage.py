"""The motorised Z stage under the block, in Zaber's ASCII protocol, in micrometres."""

from __future__ import annotations

import re
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from rig.hardware.clock import Clock
from rig.hardware.errors import SerialDeviceError
from rig.hardware.serial_line import SerialLine
from rig.settings.rig_file import StageSettings

_REPLY = re.compile(
    r"@(?P<device>\d\d) (?P<axis>\d) (?P<flag>OK|RJ) (?P<status>IDLE|BUSY) (?P<warning>\S\S) (?P<data>.*)"
)
_POLL_S = 0.05
_LONGEST_MOVE_S = 120.0


@dataclass(frozen=True)
class _Reply:
    busy: bool
    warning: str
    data: str


class Stage:
    """A linear stage, as a context manager. ``port`` resolved; ``clock``: moves take the bench's time.

    Without a reference position (after power-up) the first move homes it.
    """

    def __init__(self, settings: StageSettings, port: str, clock: Clock) -> None:
        self._number = settings.device_number
        self._microstep_um = settings.microstep_um
        self._clock = clock
        self._line = SerialLine("stage", port, baud_rate=settings.baud_rate)

    def __enter__(self) -> Self:
        try:
            self._ask("")
        except SerialDeviceError:
            self._line.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._line.close()

    @property
    def position_um(self) -> float:
        """Where the carriage is, um."""
        data = self._ask("get pos").data
        try:
            return int(data) * self._microstep_um
        except ValueError:
            raise self._line.failure(f"its position is no number: {data!r}") from None

    def home(self) -> None:
        """Move to the reference switch, which gives positions their meaning, and wait."""
        self._ask("home")
        self._wait()

    def move_to_um(self, position_um: float) -> None:
        """Move to a height, um above the reference, and wait until it is there."""
        if self._ask("").warning in {"WR", "FS", "NC"}:
            self.home()
        self._ask(f"move abs {round(position_um / self._microstep_um)}")
        self._wait()

    def _wait(self) -> None:
        waited_s = 0.0
        while self._ask("").busy:
            if waited_s > _LONGEST_MOVE_S:
                raise self._line.failure(f"still moves after {_LONGEST_MOVE_S:g} s")
            self._clock.sleep(_POLL_S)
            waited_s += _POLL_S

    def _ask(self, command: str) -> _Reply:
        said = f"/{self._number} {command}".rstrip()
        self._line.send(said, "\n")
        line = self._line.read()
        while line.startswith(("!", "#")):  # alerts and remarks come unasked
            line = self._line.read()
        match = _REPLY.fullmatch(line)
        if match is None or int(match["device"]) != self._number:
            raise self._line.failure(
                f"answered {line!r} to {said!r}, which is no reply of device {self._number}"
            )
        if match["flag"] == "RJ":
            raise self._line.failure(f"rejected {said!r}: {match['data']}")
        return _Reply(match["status"] == "BUSY", match["warning"], match["data"])
