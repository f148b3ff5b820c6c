"""Options and fixtures that several rooms' tests share."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """`pytest --rig RIG.toml`: the hardware's contract test on that rig instead of the simulated one."""
    parser.addoption("--rig", type=Path, default=None, help="rig file of a real card, nothing below the arm")


def _bench_trials_module() -> ModuleType:
    # by its path: with this folder on sys.path, tests/rig would hide the package rig
    spec = spec_from_file_location("bench_trials", Path(__file__).with_name("bench_trials.py"))
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def bench_trials() -> Callable[..., Any]:
    """Function (settings or TOML, plans) -> analysis trials recorded on a simulated bench."""
    function: Callable[..., Any] = _bench_trials_module().bench_trials
    return function


@pytest.fixture(scope="session")
def as_trial() -> Callable[..., Any]:
    """Function that turns a trial recorded offline on the simulated bench into an analysis trial."""
    function: Callable[..., Any] = _bench_trials_module().as_trial
    return function
