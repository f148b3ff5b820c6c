"""What the window knows of the bench, in one frozen piece; every widget renders it, none keeps its own."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from rig.engine.progress import Snapshot
from rig.engine.states import ENDED, State

Link = Literal["closed", "opening", "open", "silent", "died"]

IDLE = Snapshot(title="", state=State.IDLE)

AT_REST = ENDED | {State.IDLE}


@dataclass(frozen=True, slots=True)
class BenchState:
    """The link to the bench, its last snapshot, and the requests that have not been answered yet."""

    link: Link = "closed"
    rig: str = ""
    snapshot: Snapshot = IDLE
    asked: frozenset[str] = field(default_factory=frozenset)
    trouble: str = ""

    @property
    def running(self) -> bool:
        """Whether a run is in progress, as far as is known."""
        return self.link in {"open", "silent"} and self.snapshot.state not in AT_REST

    @property
    def ready(self) -> bool:
        """Whether a run can be started."""
        at_rest = self.link == "open" and self.snapshot.state in AT_REST
        return at_rest and "run" not in self.asked and not self.snapshot.trouble

    @property
    def simulated(self) -> bool:
        """Whether the bench is a simulation."""
        return self.snapshot.bench is not None and self.snapshot.bench.simulated

    @property
    def words(self) -> str:
        """What the bench does, in words."""
        if self.link != "open":
            return {
                "closed": "no rig connected",
                "opening": "connecting ...",
                "silent": "the rig does not answer",
                "died": "the rig's program has died" if self.snapshot.bench else "the rig did not open",
            }[self.link]
        if self.snapshot.trouble and not self.running:
            return "the arm can't be read"
        if self.snapshot.state is State.IDLE:
            return "ready"
        if self.snapshot.pausing and self.snapshot.state is not State.PAUSED:
            return f"{self.snapshot.state}, then pause"
        return str(self.snapshot.state)
