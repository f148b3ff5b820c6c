"""What the engine acts on: the arm, the hands, the clock and, where there are any, stage and balance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from analysis.recordings.trial import Source
from rig.hardware.clock import Clock
from rig.hardware.lever import Lever
from rig.hardware.operator import Operator


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
