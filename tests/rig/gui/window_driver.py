"""A hand on the real window's keys: loads, starts, presses, waits, and answers what the window asks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QAbstractButton, QApplication, QWidget

from rig.engine.states import State
from rig.gui.habits import Habits
from rig.gui.window import Window

PATIENCE_MS = 60_000
STUDY = """kind = "study"
[study]
fingers = ["index"]
depths_mm = [0.3]
repeats = {repeats}
rest_s = 1.0
[surface]
start_mm = 2.5
approach_speed_mm_s = {approach}
[indentation]
dwell_s = 0.3
ramp_speed_mm_s = 0.3
hold_s = {hold}
"""


class Asked:
    """Answers the window's questions in the place of a person: with the choice that is named."""

    def __init__(self) -> None:
        self.answer = ""
        self.asked: list[str] = []

    def __call__(self, _: Any, title: str, text: str, choices: Any) -> None:
        self.asked.append(f"{title}: {text}")
        if self.answer in choices:
            choices[self.answer]()


class Driver:
    """A window on the rig, and a hand on its keys."""

    def __init__(self, window: Window, question: Asked, folder: Path, qtbot: Any) -> None:
        self.window, self.question, self.folder, self.qtbot = window, question, folder, qtbot

    def until(self, condition: Callable[[], object]) -> None:
        try:
            self.qtbot.waitUntil(lambda: bool(condition()), timeout=PATIENCE_MS)
        except self.qtbot.TimeoutError:
            pytest.fail(f"{self.window.link.state}\n{self.log()}")

    def load(self, name: str, *, hold: float = 20.0, approach: float = 2.0, repeats: int = 1) -> Path:
        protocol = self.folder / f"{name}.toml"
        protocol.write_text(STUDY.format(hold=hold, approach=approach, repeats=repeats))
        assert self.window.study.load(protocol, self.folder / name)
        return self.folder / name

    def start(self, *, by_bench: bool = True) -> None:
        self.window.study.by_bench.setChecked(by_bench)
        self.window.shell.show_page("Study")
        self.press(Qt.Key.Key_F5)

    def press(self, key: Qt.Key, modifier: Any = Qt.KeyboardModifier.NoModifier) -> None:
        if QApplication.activeWindow() is None:  # without a screen nobody hands it back after a dialog
            self.window.activateWindow()
            self.qtbot.waitUntil(lambda: QApplication.activeWindow() is self.window)
        QTest.keyClick(QApplication.focusWidget() or self.window, key, modifier)

    def click(self, text: str, inside: QWidget) -> None:
        """Press the button that is seen and says this."""
        found = [
            button
            for button in inside.findChildren(QAbstractButton)
            if text in button.text().replace("&", "") and button.isVisible() and button.isEnabled()
        ]
        assert found, (
            f"{text}: no such button; there are {[b.text() for b in inside.findChildren(QAbstractButton)]}"
        )
        QTest.mouseClick(found[0], Qt.MouseButton.LeftButton)

    @property
    def state(self) -> State:
        return self.window.link.state.snapshot.state

    def at_rest(self) -> bool:
        return not self.window.link.state.running and self.state is State.IDLE

    def log(self) -> str:
        return self.window.log.view.toPlainText()


def make_window(folder: Path, question: Asked) -> Window:
    window = Window(Habits(folder / "habits.json"), folder / "logs", question)
    window.resize(1366, 768)
    window.show()
    return window
