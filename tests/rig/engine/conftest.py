"""A simulated bench, opened as any rig is, in virtual time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from rig.engine.bench import Bench
from rig.engine.control import Control
from rig.engine.interrupts import Interrupts
from rig.engine.progress import Snapshot
from rig.engine.resuming import standing
from rig.engine.runner import Recorded, Runner
from rig.engine.session import open_bench
from rig.engine.states import State
from rig.hardware.lever import Chunk
from rig.hardware.remote import ControlService
from rig.protocols.planning import plan_of
from rig.settings.reading import parse_protocol, parse_rig

RIG = """
[card]
address = "companion:card"
loopback_channel = "ai2"
read_interval_s = 0.05
[guard]
heartbeat_timeout_s = 60.0            # these tests share their computer with others, and none of them hangs
[stage]
port = "companion:stage"
[balance]
port = "companion:balance"
[operator]
address = "companion:control"
[clock]
address = "companion:control"
[companion]
command = ["{python}", "-m", "sim_hardware"]
[companion.settings]
seed = 3
time = "virtual"
"""


@dataclass
class Witness:
    """An observer that remembers, and may do something at a state."""

    at: Callable[[Snapshot], None] = lambda _: None
    snapshots: list[Snapshot] = field(default_factory=list)
    samples: int = 0
    marks: list[tuple[str, int]] = field(default_factory=list)

    def show(self, snapshot: Snapshot) -> None:
        self.snapshots.append(snapshot)
        self.at(snapshot)

    def follow(self, chunk: Chunk) -> None:
        self.samples += chunk.n

    def mark(self, name: str, sample: int, now: int) -> None:
        self.marks.append((name, sample))

    @property
    def states(self) -> list[State]:
        """The states in order, each once as long as it lasted."""
        passed: list[State] = []
        for snapshot in self.snapshots:
            if not passed or passed[-1] is not snapshot.state:
                passed.append(snapshot.state)
        return passed


@dataclass
class OpenBench:
    """An open bench, and what lies behind it."""

    bench: Bench
    control: ControlService

    def arm(self) -> dict[str, Any]:
        answer = self.control.call("arm")
        assert isinstance(answer, dict)
        return answer

    @property
    def safe(self) -> bool:
        """Whether the arm is at the safe position and touches nothing."""
        arm = self.arm()
        safe_mm = self.bench.lever.limits.safe_position_mm
        return abs(arm["position_mm"] - safe_mm) < 0.5 and not arm["in_contact"]

    def run(
        self,
        toml: str,
        out: Path,
        *,
        witness: Witness | None = None,
        interrupts: Interrupts | None = None,
        control: Control | None = None,
        patience_s: float = 60.0,
    ) -> list[Recorded]:
        """Run what is left of a protocol in a folder, as `indenter run` does."""
        plan = plan_of(parse_protocol(toml, "test.toml"), 0.5, toml)
        left = standing(plan, toml, out)
        out.mkdir(exist_ok=True)
        (out / "protocol.toml").write_text(toml)
        # what a witness does at a state it does in that state, however busy the computer
        runner = Runner(
            self.bench,
            control.interrupts if control else interrupts or Interrupts(),
            [witness or Witness()],
            control=control,
            patience_s=patience_s,
        )
        return runner.run(plan, left.tasks, out)


@contextmanager
def opened(text: str) -> Iterator[OpenBench]:
    rig = parse_rig(text, "rig.toml")
    with open_bench(rig, rig.calibration.nominal()) as bench:
        service = bench.operator._service  # type: ignore[attr-defined]
        yield OpenBench(bench, service)


@pytest.fixture(scope="session")
def bench() -> Iterator[OpenBench]:
    with opened(RIG) as running:
        yield running


@pytest.fixture
def bench_of() -> Callable[[str], Any]:
    """Context manager (more TOML after [companion.settings]) -> an open bench."""
    return lambda more: opened(RIG + more)


@pytest.fixture
def witness() -> type[Witness]:
    return Witness
