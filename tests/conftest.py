"""Options and fixtures that several rooms' tests share."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from hypothesis import settings

# the same examples in every run: what fails here fails there
settings.register_profile("fixed", derandomize=True)
settings.load_profile("fixed")

# small matrices: threads of the linear algebra would only spin beside each other (set before numpy is loaded)
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")


def pytest_addoption(parser: pytest.Parser) -> None:
    """`pytest --rig RIG.toml`: the hardware's contract test on that rig instead of the simulated one."""
    parser.addoption("--rig", type=Path, default=None, help="rig file of a real card, nothing below the arm")


@pytest.fixture
def full_pipe() -> Iterator[tuple[int, int]]:
    """A pipe's ends to read and to write, full: it takes nothing, as a terminal held by Ctrl-S."""
    reads, writes = os.pipe()
    os.set_blocking(writes, False)
    try:
        while True:
            os.write(writes, bytes(4096))
    except BlockingIOError:
        os.set_blocking(writes, True)
    yield reads, writes
    os.close(reads)
    os.close(writes)


@pytest.fixture(scope="session")
def real_time_rig() -> str:
    """A rig file: the simulated bench in real time, loop-back wired, its clock and hands on the far side too."""
    return """
[card]
address = "companion:card"
loopback_channel = "ai2"
[operator]
address = "companion:control"
[clock]
address = "companion:control"
[guard]
heartbeat_timeout_s = 5.0             # these tests share their computer with others
[companion]
command = ["{python}", "-m", "sim_hardware"]
[companion.settings]
time = "real"
"""


def _module_at(path: Path) -> ModuleType:
    # by its file: with this folder on the path its rooms would hide the packages they are named after
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def module_at() -> Callable[[Path], ModuleType]:
    """Function (file) -> the module that a file of the tests is."""
    return _module_at


@pytest.fixture(scope="session")
def _bench_trials() -> ModuleType:
    return _module_at(Path(__file__).parent / "bench_trials.py")


@pytest.fixture(scope="session")
def bench_trials(_bench_trials: ModuleType) -> Callable[..., Any]:
    """Function (settings or TOML, plans) -> analysis trials recorded on a simulated bench."""
    function: Callable[..., Any] = _bench_trials.bench_trials
    return function


@pytest.fixture(scope="session")
def as_trial(_bench_trials: ModuleType) -> Callable[..., Any]:
    """Function that turns a trial recorded offline on the simulated bench into an analysis trial."""
    function: Callable[..., Any] = _bench_trials.as_trial
    return function
