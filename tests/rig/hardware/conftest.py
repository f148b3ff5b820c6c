"""Benches for the hardware's tests: simulated ones, started as programs, and the one of --rig."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from rig.hardware.companion import Companion
from rig.hardware.lever import Lever
from rig.hardware.remote import ControlService
from rig.settings.reading import load_rig, parse_rig
from rig.settings.rig_file import RigFile


@dataclass(frozen=True)
class RunningBench:
    """A rig file and a simulated bench that serves it."""

    rig: RigFile
    companion: Companion
    control: ControlService

    @property
    def card_address(self) -> str:
        return self.companion.resolve("companion:card")

    def arm(self) -> dict[str, Any]:
        answer = self.control.call("arm")
        assert isinstance(answer, dict)
        return answer

    def lever(self, rig: RigFile | None = None, guard: Any = None) -> Lever:
        rig = self.rig if rig is None else rig
        return Lever(rig, self.card_address, rig.calibration.nominal(), guard)


def rig_toml(
    *,
    time: str = "virtual",
    wired: bool = True,
    seed: int = 1,
    card: str = "",
    lever: str = "",
    more: str = "",
) -> str:
    return f"""
[card]
address = "companion:card"
{'loopback_channel = "ai2"' if wired else ""}
{card}
[lever]
{lever}
[guard]
heartbeat_timeout_s = 5.0
[companion]
command = ["{{python}}", "-m", "sim_hardware"]
[companion.settings]
seed = {seed}
time = "{time}"
loopback_wired = {str(wired).lower()}
{more}
"""


@contextmanager
def running_bench(text: str) -> Iterator[RunningBench]:
    rig = parse_rig(text, "rig.toml")
    assert rig.companion is not None
    with ExitStack() as stack:
        companion = stack.enter_context(Companion(rig.companion))
        control = ControlService(companion.resolve("companion:control"))
        stack.callback(control.close)
        yield RunningBench(rig, companion, control)


@pytest.fixture(autouse=True)
def _logs_beside_the_test(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """What a guard logs by default belongs to the test, not to the user."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


@pytest.fixture(scope="module")
def bench() -> Iterator[RunningBench]:
    """A simulated bench in virtual time, loop-back wired."""
    with running_bench(rig_toml()) as running:
        yield running


@pytest.fixture(scope="module")
def real_time_bench() -> Iterator[RunningBench]:
    """A simulated bench in real time, loop-back wired."""
    with running_bench(rig_toml(time="real")) as running:
        yield running


@pytest.fixture
def bench_of() -> Callable[..., Any]:
    """Context manager (keys of `rig_toml`) -> a running bench."""
    return lambda **keys: running_bench(rig_toml(**keys))


@pytest.fixture(scope="module")
def card_rig(request: pytest.FixtureRequest) -> Iterator[tuple[RigFile, str]]:
    """Rig file and card address under test: of --rig, else a simulated bench in real time."""
    path: Path | None = request.config.getoption("--rig")
    if path is not None:
        rig = load_rig(path)
        if rig.companion is None:
            yield rig, rig.card.address
            return
        with Companion(rig.companion) as companion:
            yield rig, companion.resolve(rig.card.address)
        return
    with running_bench(rig_toml(time="real")) as running:
        yield running.rig, running.card_address
