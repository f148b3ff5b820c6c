"""Fixtures that several rooms' tests share."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

sys.path.append(str(Path(__file__).parent))


@pytest.fixture(scope="session")
def bench_trials() -> Callable[..., Any]:
    """Function (settings or TOML, plans) -> analysis trials recorded on a simulated bench."""
    import bench_trials as module

    return module.bench_trials


@pytest.fixture(scope="session")
def as_trial() -> Callable[..., Any]:
    """Function that turns a trial recorded offline on the simulated bench into an analysis trial."""
    import bench_trials as module

    return module.as_trial
