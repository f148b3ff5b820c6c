"""The window's tests run without a screen, and leave nothing in the user's own folders."""

from __future__ import annotations

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
