"""The window's tests run without a screen, and leave nothing in the user's own folders."""

from __future__ import annotations

import gc
import json
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

TISSUE = {
    name: {"value": value, "se": 0.01 * value, "unit": unit}
    for name, value, unit in (
        ("k0_mn_per_mm", 120.0, "mN/mm"),
        ("k1_mn_per_mm", 44.52, "mN/mm"),
        ("tau1_s", 2.279, "s"),
        ("k2_mn_per_mm", 35.28, "mN/mm"),
        ("tau2_s", 0.149, "s"),
    )
}
REPORT: dict[str, Any] = {
    "format": "indenter-diagnosis",
    "format_version": 1,
    "verdict": "one_of",
    "summary": "Adhesion was found.",
    "n_trials": 2,
    "sample_rate_hz": 8000.0,
    "baseline": "ramp",
    "false_alarm_rate": 0.05,
    "mismatch": [
        {
            "signal": "force",
            "phase": "retract",
            "start_s": 3.1,
            "stop_s": 3.3,
            "mean_residual_mn": -4.1,
            "p_value": 2e-4,
            "share_of_mismatch": 0.81,
            "conditions": "every depth",
        }
    ],
    "mechanisms": [
        {
            "name": "adhesion",
            "stage": "contact",
            "alternatives": ["slip"],
            "alternative_probabilities": {"slip": 0.2},
            "probability": 0.75,
            "p_value": 2e-4,
            "parameters": {"pull_off_mn": {"value": 6.0, "se": 0.1, "unit": "mN"}},
            "explanation": "the skin clings to the punch",
        },
        {"name": "heartbeat", "stage": "specimen", "alternatives": [], "p_value": 2e-4, "parameters": {}},
    ],
    "not_identifiable": [{"name": "lever_compliance", "reason": "it hides", "separated_by": "rigid_target"}],
    "baseline_parameters": TISSUE,
    "improved_parameters": TISSUE,
    "heldout": {
        "scheme": "",
        "n_trials": 2,
        "noise_floor_mn": 0.3,
        "baseline_rms_mn": 0.92,
        "improved_rms_mn": 0.31,
    },
    "explained_share": 0.99,
    "next_experiment": {
        "protocol": "next.toml",
        "separates": [["adhesion", "slip"]],
        "reason": "It would tell.",
    },
}


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


@pytest.fixture
def report() -> dict[str, Any]:
    """The contents of a report.json that nobody's trials gave."""
    return REPORT


@pytest.fixture
def diagnosis() -> Callable[..., Path]:
    """Function (folder, changes of the report) -> the folder, holding a diagnosis that is made up."""

    def made(folder: Path, **changes: Any) -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "report.json").write_text(json.dumps(REPORT | changes))
        (folder / "report.html").write_text("<html></html>")
        (folder / "twin.toml").write_text("")
        (folder / "next.toml").write_text("")
        return folder

    return made


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
    window.close_now()


@pytest.fixture
def drive(opened: tuple[Any, Any], folder: Path, qtbot: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    window, question = opened
    question.answer = ""
    question.asked.clear()
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    driver = _driver().Driver(window, question, folder, qtbot)
    driver.until(lambda: window.link.state.link == "open" and driver.at_rest())
    return driver
