"""What the engine acts on: the arm, the hands, the clock and, where there are any, stage and balance."""

from __future__ import annotations

from dataclasses import dataclass

from analysis.recordings.trial import Source
from rig.hardware.balance import Balance
from rig.hardware.clock import Clock
from rig.hardware.lever import Lever
from rig.hardware.operator import Operator
from rig.hardware.stage import Stage


@dataclass(frozen=True)
class Bench:
    """An open bench.

    `operator` is what stands in for hands; None where they are a person's. `read_s` is the time read and
    written at once while nothing happens. `rig` is the rig's name, `guards` the processes that watch over the arm.
    """

    lever: Lever
    clock: Clock
    operator: Operator | None
    stage: Stage | None
    balance: Balance | None
    source: Source
    read_s: float = 0.05
    rig: str = ""
    guards: tuple[int, ...] = ()
