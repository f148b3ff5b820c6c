"""The balance that weighs the calibration weights, in MT-SICS, in grams."""

from __future__ import annotations

import re
from types import TracebackType
from typing import Self

from rig.hardware.errors import SerialDeviceError
from rig.hardware.serial_line import SerialLine
from rig.settings.rig_file import BalanceSettings

_WEIGHT = re.compile(r"S S +(?P<value>[-+]?\d+(?:\.\d+)?) (?P<unit>\S+)")
_STABLE_S = 30.0
_REASONS = {
    "S I": "is busy, or its pan never comes to rest",
    "S +": "is overloaded",
    "S -": "is underloaded; put the pan back",
    "Z I": "can't be zeroed now",
    "Z +": "has too much on the pan to be zeroed",
    "Z -": "has too little on the pan to be zeroed",
    "ES": "does not know the command",
    "ET": "received it garbled",
    "EL": "can't execute it",
}


class Balance:
    """A balance, as a context manager. ``port`` resolved."""

    def __init__(self, settings: BalanceSettings, port: str) -> None:
        self._line = SerialLine("balance", port, baud_rate=settings.baud_rate)

    def __enter__(self) -> Self:
        try:
            self.weigh_now_g()
        except SerialDeviceError:
            self._line.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._line.close()

    def zero(self) -> None:
        """Set the empty pan to zero once it is at rest."""
        answer = self._ask("Z")
        if answer != "Z A":
            raise self._refusal("Z", answer)

    def weigh_g(self) -> float:
        """The mass on the pan once it is at rest, g."""
        return self._grams("S", self._ask("S"))

    def weigh_now_g(self) -> float:
        """The mass on the pan at this moment, at rest or not, g."""
        return self._grams("SI", self._ask("SI").replace("S D", "S S", 1))

    def _ask(self, command: str) -> str:
        self._line.send(command, "\r\n")
        return self._line.read(_STABLE_S)

    def _grams(self, command: str, answer: str) -> float:
        match = _WEIGHT.fullmatch(answer)
        if match is None:
            raise self._refusal(command, answer)
        if match["unit"] != "g":
            raise self._line.failure(f"weighs in {match['unit']}; set it to grams")
        return float(match["value"])

    def _refusal(self, command: str, answer: str) -> SerialDeviceError:
        return self._line.failure(_REASONS.get(answer.strip(), f"answered {answer!r} to {command!r}"))
