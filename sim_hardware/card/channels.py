"""Physical channels and terminals of the one device, Dev1: four inputs, two outputs."""

import re
from dataclasses import dataclass
from typing import Literal

from sim_hardware.card.errors import CardError, Code

DEVICE = "Dev1"
RANGE_V = 10.0
N_CHANNELS = {"ai": 4, "ao": 2}

Direction = Literal["ai", "ao"]

_ITEM = re.compile(r"(?P<direction>ai|ao)(?P<first>\d+)(?::(?:ai|ao)?(?P<last>\d+))?", re.IGNORECASE)
_TERMINALS = {"ai/StartTrigger", "ao/StartTrigger", "ai/SampleClock", "ao/SampleClock", "PFI0", "PFI1"}


@dataclass(frozen=True)
class Channel:
    """One virtual channel; range in volts."""

    name: str
    direction: Direction
    index: int
    min_v: float
    max_v: float

    @property
    def physical(self) -> str:
        """The terminal it stands for, as `Dev1/ai0`."""
        return f"{DEVICE}/{self.direction}{self.index}"


def check_device(name: str) -> None:
    """Raise CardError (-200220) unless `name` is this card."""
    if name.strip("/").lower() != DEVICE.lower():
        raise CardError(Code.NO_SUCH_DEVICE, f"Device Specified: {name}.")


def parse_channels(
    physical: str, name: str, direction: Direction, min_v: float, max_v: float
) -> list[Channel]:
    """Channels of a list such as `Dev1/ai0:2, Dev1/ai3`; CardError on any that the card does not have."""
    if not -RANGE_V <= min_v < max_v <= RANGE_V:
        raise CardError(Code.INVALID_VALUE, f"Range: {min_v} to {max_v} V.")
    channels = []
    for item in filter(None, (part.strip() for part in physical.split(","))):
        device, _, rest = item.strip("/").partition("/")
        check_device(device)
        match = _ITEM.fullmatch(rest)
        if match is None or match["direction"].lower() != direction:
            raise CardError(Code.NO_SUCH_CHANNEL, f"Physical Channel Name: {item}.")
        first = int(match["first"])
        last = int(match["last"] or first)
        for index in range(first, last + 1) if first <= last else range(first, last - 1, -1):
            if index >= N_CHANNELS[direction]:
                raise CardError(Code.NO_SUCH_CHANNEL, f"Physical Channel Name: {DEVICE}/{direction}{index}.")
            channels.append(Channel(f"{DEVICE}/{direction}{index}", direction, index, min_v, max_v))
    if not channels:
        raise CardError(Code.NO_SUCH_CHANNEL, "Physical Channel Name is empty.")
    if not name:
        return channels
    names = [name] if len(channels) == 1 else [f"{name}{i}" for i in range(len(channels))]
    return [Channel(n, direction, c.index, min_v, max_v) for n, c in zip(names, channels, strict=True)]


def parse_terminal(name: str) -> str:
    """A terminal without its device, as `ai/StartTrigger`; empty for the card's own clock or no trigger."""
    bare = name.strip("/")
    if bare.lower().startswith(DEVICE.lower() + "/"):
        bare = bare[len(DEVICE) + 1 :]
    if bare.lower() in {"", "onboardclock", "none"}:
        return ""
    for terminal in _TERMINALS:
        if bare.lower() == terminal.lower():
            return terminal
    raise CardError(Code.TERMINAL_NOT_FOUND, f"Source Terminal: {name}.")
