"""What several benchmarks need: the simulator of the relaxation tests, and processors kept busy."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

# a window is measured without a screen, where there is one and where there is none
os.environ["QT_QPA_PLATFORM"] = "offscreen"


def _module(name: str, path: Path) -> ModuleType:
    spec = spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[name] = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def simulate() -> Callable[..., Any]:
    """Function that simulates a trial of exactly known tissue; see tests/analysis/relaxation/conftest.py."""
    path = Path(__file__).parents[1] / "analysis" / "relaxation" / "conftest.py"
    function: Callable[..., Any] = _module("relaxation_simulator", path).simulate_trial
    return function


@pytest.fixture(scope="session")
def standing_bench() -> Callable[[Path], AbstractContextManager[Any]]:
    """Function (folder) -> context manager of a bench that outlives those who use it; see standing_bench.py."""
    path = Path(__file__).parent / "standing_bench.py"
    function: Callable[..., Any] = _module("standing_bench", path).standing_bench
    return function


@contextmanager
def _busy() -> Iterator[None]:
    # sessions of their own: other work is another terminal's, and Linux shares the processors out by session
    spinners = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"], start_new_session=True)
        for _ in range(os.cpu_count() or 1)
    ]
    try:
        yield
    finally:
        for spinner in spinners:
            spinner.kill()
            spinner.wait()


@pytest.fixture(scope="session")
def busy_processors() -> Callable[[], AbstractContextManager[None]]:
    """Context manager that keeps every processor busy with other work."""
    return _busy
