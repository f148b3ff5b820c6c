"""The window's tests run without a screen, and leave nothing in the user's own folders."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable, Iterator
from functools import cache
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
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


@cache
def _driver() -> ModuleType:
    # by its file: the tests' folders are no packages
    spec = spec_from_file_location("window_driver", Path(__file__).parent / "window_driver.py")
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[spec.name] = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, real_time_rig: str) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("window")
    patch = pytest.MonkeyPatch()
    for name, value in (
        ("INDENTER_RUNTIME_DIR", "runs"),
        ("XDG_CACHE_HOME", "cache"),
        ("XDG_CONFIG_HOME", "config"),
        ("XDG_DATA_HOME", "data"),
    ):
        patch.setenv(name, str(folder / value))
    stage = '[stage]\nport = "companion:stage"\n[balance]\nport = "companion:balance"\n'
    (folder / "rig.toml").write_text(stage + real_time_rig)
    yield folder
    patch.undo()


@pytest.fixture(scope="module")
def opened(folder: Path, qapp: Any) -> Iterator[tuple[Any, Any]]:
    driver = _driver()
    question = driver.Asked()
    window = driver.make_window(folder, question)
    window.connect_rig(folder / "rig.toml")
    yield window, question
    question.answer = "Stop the run and close"
    window.close()


@pytest.fixture
def drive(opened: tuple[Any, Any], folder: Path, qtbot: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    window, question = opened
    question.answer = ""
    question.asked.clear()
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    driver = _driver().Driver(window, question, folder, qtbot)
    driver.until(lambda: window.link.state.link == "open" and driver.at_rest())
    return driver
