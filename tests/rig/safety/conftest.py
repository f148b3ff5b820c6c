"""A simulated bench that outlives the runs on it, and is the judge of the force on the finger."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil
import pytest

from analysis.recordings.trial import Calibration
from rig.commands.safe import make_safe
from rig.engine.interrupts import Interrupts
from rig.engine.progress import Snapshot
from rig.engine.runner import Runner, Task
from rig.engine.session import open_bench
from rig.hardware.companion import Companion
from rig.hardware.remote import ControlService
from rig.protocols.planning import plan_of
from rig.settings.reading import check_protocol_on_rig, parse_protocol, parse_rig

SAFE_MM = 0.5
BEFORE_CONTACT_MN = 25.0
"""Most force on the finger before the skin was found."""
ONE = """kind = "ramp_hold_retract"
[surface]
start_mm = 2.5
[indentation]
depth_mm = 0.4
dwell_s = 0.3
hold_s = 1.0
"""


@dataclass
class Witness:
    """An observer that does something, once, when a run comes to a state."""

    state: str = ""
    act: Callable[[], None] = lambda: None
    states: list[str] = field(default_factory=list)

    def show(self, snapshot: Snapshot) -> None:
        if not self.states or self.states[-1] != str(snapshot.state):
            self.states.append(str(snapshot.state))
            if str(snapshot.state) == self.state:
                self.state = ""
                self.act()

    def follow(self, _: Any) -> None:
        pass

    def mark(self, *_: Any) -> None:
        pass


@dataclass
class Standing:
    """A bench, by its addresses."""

    companion: Companion
    control: ControlService
    folder: Path

    def call(self, method: str, *arguments: Any) -> Any:
        """Call the bench from any thread."""
        service = ControlService(self.control.address)
        try:
            return service.call(method, *arguments)
        finally:
            service.close()

    def fault(self, kind: str, **details: Any) -> None:
        self.call("fault", kind, details)

    def largest_force_mn(self) -> float:
        return float(self.call("largest_force"))

    @property
    def clear(self) -> bool:
        """Whether the arm touches nothing and is near its safe position."""
        arm = self.call("arm")
        return not arm["in_contact"] and abs(arm["position_mm"] - SAFE_MM) < 0.3

    def seconds_until_clear(self, within_s: float = 20.0) -> float:
        began_s = time.monotonic()
        while not self.clear:
            assert time.monotonic() - began_s < within_s, self.call("arm")
            time.sleep(0.005)
        return time.monotonic() - began_s

    def rig_toml(self, more: str = "", *, timeout_s: float = 3.0, wired: bool = True) -> str:
        control = self.companion.resolve("companion:control")
        return (
            f'[card]\naddress = "{self.companion.resolve("companion:card")}"\n'
            + ('loopback_channel = "ai2"\n' if wired else "")
            + f'[operator]\naddress = "{control}"\n[clock]\naddress = "{control}"\n'
            f'[guard]\nheartbeat_timeout_s = {timeout_s}\nlog_file = "{self.folder / "guard.log"}"\n{more}'
        )

    def run(
        self,
        protocol: str = ONE,
        *,
        rig: str | None = None,
        calibration: Calibration | None = None,
        witness: Witness | None = None,
        name: str = "out",
    ) -> Path:
        """Run a protocol in this process; the file of its first trial."""
        settings = parse_rig(rig or self.rig_toml(), "rig.toml")
        asked = parse_protocol(protocol, "test.toml")
        check_protocol_on_rig(asked, settings, "test.toml")
        plan = plan_of(asked, 0.5, protocol)
        out = self.folder / name
        out.mkdir(exist_ok=True)
        tasks = [Task(trial, out / f"{trial.name}.h5") for trial in plan.trials]
        with open_bench(settings, calibration or settings.calibration.nominal()) as bench:
            Runner(bench, Interrupts(), [witness or Witness()]).run(plan, tasks, out)
        return tasks[0].path

    @contextmanager
    def program(self, protocol: str = ONE, *, rig: str | None = None, name: str = "out") -> Iterator[Program]:
        """`indenter run` as a process of its own."""
        (self.folder / "rig.toml").write_text(rig or self.rig_toml())
        (self.folder / f"{name}.toml").write_text(protocol)
        command = [sys.executable, "-m", "rig.cli", "run", str(self.folder / f"{name}.toml")]
        command += ["--rig", str(self.folder / "rig.toml"), "--out", str(self.folder / name)]
        environment = os.environ | {"INDENTER_RUNTIME_DIR": str(self.folder / "runs")}
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environment
        )
        program = Program(process, self)
        try:
            yield program
        finally:
            program.end()


@dataclass
class Program:
    """A run in a process of its own, and its guards."""

    process: subprocess.Popen[str]
    bench: Standing
    lines: list[tuple[float, str]] = field(default_factory=list)
    """What it and its guards said, and when."""
    seen_guards: list[psutil.Process] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._hearing = threading.Thread(target=self._hear, daemon=True)
        self._hearing.start()

    def _hear(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.lines.append((time.monotonic(), line))

    @property
    def said(self) -> str:
        return "".join(line for _, line in self.lines)

    def told_to_lift_s(self) -> float:
        """When the person was told to lift the arm, on the clock of time.monotonic(); infinity if never."""
        told = [when for when, line in self.lines if "lift it by hand" in line.lower()]
        return told[0] if told else float("inf")

    def until_pressed(self, least_mn: float = 20.0, within_s: float = 60.0) -> None:
        """Wait until the finger feels so much."""
        self._wait(lambda: self.bench.call("arm")["force_mn"] > least_mn, within_s)

    def until_moving(self, beyond_mm: float, within_s: float = 60.0) -> None:
        self._wait(lambda: self.bench.call("arm")["position_mm"] > beyond_mm, within_s)

    def _wait(self, condition: Callable[[], bool], within_s: float) -> None:
        deadline_s = time.monotonic() + within_s
        while not condition():
            assert self.process.poll() is None, self.said
            assert time.monotonic() < deadline_s, "did not happen in time"
            time.sleep(0.002)
        assert self.guards  # noted, to be ended with the test

    @property
    def guards(self) -> list[int]:
        """The guard's process and the second guard's."""
        found = []
        for child in psutil.Process(self.process.pid).children(recursive=True):
            words = ""
            with contextlib.suppress(psutil.Error):
                words = " ".join(child.cmdline())
            if "guard_process" in words:
                found.insert(0, child)
            elif "second_guard" in words:
                found.append(child)
        self.seen_guards = found or self.seen_guards
        return [guard.pid for guard in found]

    def signal(self, number: int = signal.SIGKILL) -> None:
        self.process.send_signal(number)

    def wait(self, within_s: float = 40.0) -> int:
        """Wait for its end, and its guards'; the exit code."""
        end_s = time.monotonic() + within_s
        code = self.process.wait(within_s)
        self._hearing.join(end_s - time.monotonic())
        assert not self._hearing.is_alive(), "the program does not exit"
        return code

    def end(self) -> None:
        """Let nothing of it stay, frozen or not: what holds the arm then is the next run's business."""
        running = self.process.poll() is None
        if running:
            assert self.guards is not None  # those that are there now
        for guard in self.seen_guards:
            with contextlib.suppress(psutil.NoSuchProcess):
                guard.kill()  # that process, and none that has its number by now
        if running:
            self.process.kill()
            self.process.wait()
        self._hearing.join(10.0)
        assert self.process.stderr is not None
        self.process.stderr.close()


@contextmanager
def standing(folder: Path, settings: str) -> Iterator[Standing]:
    rig = parse_rig(
        f'[companion]\ncommand = ["{{python}}", "-m", "sim_hardware"]\n[companion.settings]\n{settings}',
        "bench",
    )
    assert rig.companion is not None
    with Companion(rig.companion) as companion:
        with contextlib.suppress(PermissionError):
            # it stands for a card and an arm, which wait for no processor
            os.setpriority(os.PRIO_PROCESS, companion.pid, -10)
        control = ControlService(companion.resolve("companion:control"))
        yield Standing(companion, control, folder)
        control.close()


@pytest.fixture(scope="module")
def _virtual(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Standing]:
    with standing(tmp_path_factory.mktemp("bench"), 'seed = 3\ntime = "virtual"\n') as bench:
        yield bench


@pytest.fixture(scope="module")
def _real(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Standing]:
    with standing(tmp_path_factory.mktemp("bench"), 'seed = 3\ntime = "real"\n') as bench:
        yield bench


def _fresh(bench: Standing, folder: Path) -> Standing:
    bench.fault("mend")
    bench.call("request", "clear_air", {})
    if not bench.clear:  # a test that failed left it away
        (folder / "rig.toml").write_text(Standing(bench.companion, bench.control, folder).rig_toml())
        make_safe(folder / "rig.toml")
    bench.largest_force_mn()
    return Standing(bench.companion, bench.control, folder)


@pytest.fixture(scope="module")
def good_run_mn(_virtual: Standing, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], float]:
    """Function (protocol) -> the largest force on the finger in a run of it without a fault, mN."""

    def run(protocol: str) -> float:
        bench = _fresh(_virtual, tmp_path_factory.mktemp("good"))
        bench.run(protocol)
        return bench.largest_force_mn()

    return run


@pytest.fixture
def bench(_virtual: Standing, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Standing:
    """A bench in virtual time, its wires whole."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return _fresh(_virtual, tmp_path)


@pytest.fixture
def real_bench(_real: Standing, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Standing:
    """A bench in real time, its wires whole."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return _fresh(_real, tmp_path)


@pytest.fixture
def witness() -> type[Witness]:
    return Witness
