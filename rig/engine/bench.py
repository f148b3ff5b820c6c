"""What the engine acts on: the arm, the hands, the clock and, where there are any, stage and balance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from analysis.recordings.trial import Source
from rig.hardware.lever import Lever


class Clock(Protocol):
    """Tells the bench's time and lets it pass: the system's, or that of a simulated bench."""

    def time_s(self) -> float:
        """Return the time now, s."""
        ...

    def sleep(self, duration_s: float) -> None:
        """Let so much time pass."""
        ...


class Operator(Protocol):
    """The hands at the bench: a person at the console, or a control service."""

    def request(self, kind: str, details: Mapping[str, Any]) -> str:
        """Ask for something and wait until it is done; return what was done in a few words."""
        ...


class Stage(Protocol):
    """A motorised Z stage."""

    def move_to_um(self, position_um: float) -> None:
        """Move to a height, um, and wait until it is there."""
        ...


class Balance(Protocol):
    """A balance."""

    def weigh_g(self) -> float:
        """Return the mass on the pan, g."""
        ...


@dataclass(frozen=True)
class Bench:
    """An open bench."""

    lever: Lever
    clock: Clock
    operator: Operator
    stage: Stage | None
    balance: Balance | None
    source: Source
