"""The window's tests run without a screen, and leave nothing in the user's own folders."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

os.environ["QT_QPA_PLATFORM"] = "offscreen"


@pytest.fixture(autouse=True)
def _own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("XDG_CONFIG_HOME", "XDG_CACHE_HOME", "XDG_STATE_HOME"):
        monkeypatch.setenv(name, str(tmp_path / "home" / name.lower()))


@pytest.fixture(scope="module", autouse=True)
def _garbage_in_this_thread() -> Iterator[None]:
    """Widgets left in cycles go here, not in whichever thread of a later test happens to collect them."""
    yield
    gc.unfreeze()  # what each window set aside
    gc.collect()


@pytest.fixture
def habits(tmp_path: Path) -> Any:
    """The habits of a user who has none yet."""
    from rig.gui.habits import Habits

    return Habits(tmp_path / "window.json")


@pytest.fixture(scope="module")
def worker(qapp: Any) -> Iterator[Any]:
    """A worker, ended after the module's tests."""
    from rig.gui.worker import Worker

    worker = Worker()
    yield worker
    worker.close()


@pytest.fixture
def asked(worker: Any, qtbot: Any) -> Callable[..., Any]:
    """Function (function, *arguments) -> what the worker's process answers."""

    def ask(function: Callable[..., Any], *arguments: Any) -> Any:
        answers: list[Any] = []
        worker.ask("a test", function, *arguments, then=answers.append, failed=pytest.fail)
        qtbot.waitUntil(lambda: bool(answers), timeout=30_000)
        return answers[0]

    return ask


@pytest.fixture(scope="session")
def simulated_trial(_bench_trials: Any) -> Callable[..., Any]:
    """Function (seed, finger, depth_mm, repeat) -> one trial of the simulated bench, short in time."""
    from sim_hardware.concealment.offline import study_plans

    def trial(seed: int = 1, finger: str = "index", depth_mm: float = 0.4, repeats: int = 1) -> list[Any]:
        plans = study_plans((finger,), (depth_mm,), repeats, hold_s=2.0, dwell_s=0.5, rest_s=10.0)
        return list(_bench_trials.bench_trials(f"seed = {seed}", plans))

    return trial


@pytest.fixture(scope="session")
def study_folder(simulated_trial: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of six short trials: two fingers, two depths; not to be changed."""
    from analysis.recordings import write_trial

    folder = tmp_path_factory.mktemp("study")
    for finger, depth_mm, repeats in (("index", 0.4, 2), ("index", 0.8, 2), ("middle", 0.4, 2)):
        for trial in simulated_trial(3, finger, depth_mm, repeats):
            name = f"{finger}_{depth_mm:.2f}mm_r{trial.specimen.repeat}.h5"
            write_trial(folder / name, trial)
    return folder
