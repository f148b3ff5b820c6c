"""Calibration finds the constants of a bench it knows nothing of; its intervals hold as often as they say.

The normal tests calibrate through the driver's client. The campaign of 200 benches stands the same runner
before the simulated world itself, without the card between, for speed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rich.console import Console

from analysis.recordings.trial import Calibration
from rig.calibration.kept import CalibrationFile, load_calibration, newest_calibration
from rig.calibration.lines import student_95
from rig.commands.calibrate import calibrate_on_bench, routine
from rig.engine.bench import Bench
from rig.hardware.lever import Chunk
from rig.settings.protocol_file import BlockDetection, PositionCalibration
from rig.settings.rig_file import LeverSettings, RigFile
from sim_hardware.settings import BenchSettings
from sim_hardware.world.bench import World

FloatArray = NDArray[np.float64]
RATE_HZ = 8000.0
NOMINAL = Calibration(2.042, -10.0, 0.015, 0.0, 2.042, -10.0)


@dataclass
class WorldPlayback:
    started_sample: int
    waveform_v: FloatArray
    lever: WorldLever
    alignment_unknown: bool = False
    starved: bool = False

    @property
    def n(self) -> int:
        return len(self.waveform_v)

    @property
    def done(self) -> bool:
        return self.lever.queue is not self or self.lever.read_so_far >= self.started_sample + self.n


@dataclass
class WorldLever:
    """The lever's calls, answered by the world itself, sample by sample and without delay."""

    world: World
    calibration: Calibration = NOMINAL
    limits: LeverSettings = field(default_factory=LeverSettings)
    sample_rate_hz: float = RATE_HZ
    read_so_far: int = 0
    queue: WorldPlayback | None = None
    seen: Callable[[Chunk], bool] | None = None
    keep: Callable[[Chunk], None] | None = None
    samples_per_read: int = 1
    loopback_wired: bool = True

    def __post_init__(self) -> None:
        self.held_v = self.world.settings.initial_command_v

    @property
    def commanded_mm(self) -> float:
        c = self.calibration
        return (self.held_v - c.command_zero_v) / c.command_volts_per_mm

    @property
    def acquired(self) -> int:
        return self.read_so_far

    def start_recording(self, keep: Callable[[Chunk], None] | None = None) -> None:
        self.keep = keep
        self.read_so_far = 0
        self.queue = None

    def stop_recording(self) -> None:
        self.queue = None

    def play(self, waveform_mm: FloatArray) -> WorldPlayback:
        c = self.calibration
        volts = waveform_mm * c.command_volts_per_mm + c.command_zero_v
        self.queue = WorldPlayback(self.read_so_far, volts, self)
        return self.queue

    def play_until(
        self, waveform_mm: FloatArray, seen: Callable[[Chunk], bool], samples_per_read: int
    ) -> WorldPlayback:
        self.seen, self.samples_per_read = seen, samples_per_read
        return self.play(waveform_mm)

    def prove(self) -> None:
        pass

    def flee(self) -> None:
        pass

    def look_for_force(self, force_mn: float | None) -> None:
        pass

    def surface_found(self, position_mm: float) -> None:
        pass

    def read(self, n: int) -> Chunk:
        start, blocks = self.read_so_far, []
        while (left := start + n - self.read_so_far) > 0:
            block = self._next(min(left, self.samples_per_read) if self.seen else left)
            blocks.append((block.position_v, block.force_v, block.command_v))
            if self.seen is not None and self.seen(block):
                self.halt()
        position_v, force_v, command_v = np.hstack(blocks)
        return Chunk(start, position_v, force_v, command_v, self.calibration)

    def _next(self, n: int) -> Chunk:
        command = np.full(n, self.held_v)
        if self.queue is not None:
            done = self.read_so_far - self.queue.started_sample
            part = self.queue.waveform_v[done : done + n]
            command[: len(part)] = part
            if len(part):
                command[len(part) :] = part[-1]
                self.held_v = float(command[-1])
        readings = self.world.advance(command)
        start, self.read_so_far = self.read_so_far, self.read_so_far + n
        chunk = Chunk(start, readings.position_v, readings.force_v, command, self.calibration)
        if self.keep is not None:
            self.keep(chunk)
        return chunk

    def halt(self) -> float:
        self.queue = self.seen = None
        return self.commanded_mm

    def retreat(self) -> None:
        safe_v = self.limits.safe_position_mm * self.calibration.command_volts_per_mm
        safe_v += self.calibration.command_zero_v
        self.world.advance(np.linspace(self.held_v, safe_v, 400))
        self.world.advance(np.full(80, safe_v))
        self.held_v = safe_v


@dataclass
class WorldHands:
    """Clock, hands and stage."""

    world: World

    def time_s(self) -> float:
        return self.world.time_s

    def sleep(self, duration_s: float) -> None:
        self.world.rest(duration_s)

    def request(self, kind: str, details: Mapping[str, Any]) -> str:
        return self.world.request(kind, details)

    def home(self) -> None:
        self.move_to_um(0.0)

    def move_to_um(self, position_um: float) -> None:
        self.world.request("turn_micrometer", {"position_um": position_um})


def world_bench(seed: int) -> tuple[Bench, World]:
    world = World(BenchSettings(seed=seed))
    lever: Any = WorldLever(world)
    hands: Any = WorldHands(world)
    return Bench(lever, hands, hands, hands, None, "simulated"), world


QUIET = Console(quiet=True)


def test_position_through_the_driver(bench: Any, tmp_path: Path) -> None:
    # one approach a height, and the first from close by: the block of this bench lies at some 4.6 mm
    near = BlockDetection(start_mm=4.3)
    protocol = PositionCalibration(kind="position_calibration", repeats=1, surface=near)
    path = calibrate_on_bench(bench.bench, protocol, tmp_path, QUIET)
    found, truth = load_calibration(path), bench.control.call("truth")
    assert found.constants["volts_per_mm"].value == pytest.approx(truth["volts_per_mm"], rel=1e-3)
    # the command's zero is such that the arm stands where it is sent
    slope, zero = truth["volts_per_mm"], truth["position_zero_v"]
    command_v = 0.0
    true_mm = (command_v - truth["command_zero_v"]) / truth["command_volts_per_mm"]
    c = {name: constant.value for name, constant in found.constants.items()}
    read_mm = (true_mm * slope + zero - c["position_zero_v"]) / c["volts_per_mm"]
    sent_mm = (command_v - c["command_zero_v"]) / c["command_volts_per_mm"]
    assert read_mm == pytest.approx(sent_mm, abs=2e-3)


def test_force_through_the_driver_and_the_newest_are_used(bench: Any, tmp_path: Path) -> None:
    path = calibrate_on_bench(bench.bench, routine("force"), tmp_path, QUIET)
    truth = bench.control.call("truth")
    found = load_calibration(path)
    assert found.constants["volts_per_mn"].value == pytest.approx(truth["volts_per_mn"], rel=5e-3)
    calibration, used = newest_calibration(RigFile(), tmp_path)
    assert set(used) == {"force"}
    assert calibration.volts_per_mn == found.constants["volts_per_mn"].value
    assert calibration.volts_per_mm == NOMINAL.volts_per_mm
    assert calibration.standard_errors["volts_per_mn"] > 0
    # a second one, later, takes its place
    text = path.read_text().replace(str(found.constants["volts_per_mn"].value), "0.016")
    text = text.replace(found.calibrated, (found.made + timedelta(minutes=1)).isoformat())
    (tmp_path / "force-later.json").write_text(text)
    assert newest_calibration(RigFile(), tmp_path)[0].volts_per_mn == 0.016


@pytest.mark.parametrize("which", ["position", "force"])
@pytest.mark.parametrize("seed", [11, 12])
def test_on_the_world_itself(which: Any, seed: int, tmp_path: Path) -> None:
    bench, world = world_bench(seed)
    found = load_calibration(calibrate_on_bench(bench, routine(which), tmp_path, QUIET))
    name, within = ("volts_per_mm", 1e-3) if which == "position" else ("volts_per_mn", 5e-3)
    assert found.constants[name].value == pytest.approx(getattr(world.constants, name), rel=within)


def _calibrated(which: Any, seed: int, folder: Path) -> tuple[float, float, bool]:
    """Calibrate a bench; the relative error, the relative standard error, and whether the interval holds."""
    bench, world = world_bench(seed)
    path = calibrate_on_bench(bench, routine(which), folder, QUIET)
    name = "volts_per_mm" if which == "position" else "volts_per_mn"
    found: CalibrationFile = load_calibration(path)
    truth = getattr(world.constants, name)
    constant = found.constants[name]
    half = student_95(constant.dof) * constant.se
    error = constant.value - truth
    return error / truth, constant.se / truth, abs(error) <= half


@pytest.mark.slow
@pytest.mark.parametrize("which", ["position", "force"])
def test_campaign_of_200_benches(which: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results: list[tuple[float, float, bool]] = []
    for seed in range(200):
        results.append(_calibrated(which, 1000 + seed, tmp_path / str(seed)))
        if len(results) % 20 == 0:
            with capsys.disabled():
                worst = max(abs(error) for error, _, _ in results)
                n_held = sum(holds for _, _, holds in results)
                print(f"\n{which}: {len(results)} of 200, largest {worst:.2e}, {n_held} intervals hold")
    errors = np.array([error for error, _, _ in results])
    held = float(np.mean([holds for _, _, holds in results]))
    limit = 1e-3 if which == "position" else 5e-3
    with capsys.disabled():
        print(
            f"\n{which}: 200 benches, relative error rms {np.sqrt(np.mean(errors**2)):.2e}, largest "
            f"{np.max(np.abs(errors)):.2e} (limit {limit:g}); 95 % intervals hold in {100 * held:.1f} %"
        )
    assert np.max(np.abs(errors)) < limit
    # 200 true 95 % intervals hold in fewer than 89 % or more than 99.5 % less than once in a thousand times
    assert 0.89 <= held <= 0.995
