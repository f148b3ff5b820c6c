"""What holds for every page that needs no bench: names for who can't see, keys, no leaks, pictures."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QShortcut
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QApplication,
    QComboBox,
    QLabel,
    QLineEdit,
    QPushButton,
    QWidget,
)
from pytestqt.qtbot import QtBot

from rig.gui.actions import TABLE
from rig.gui.fit_panel import FitPanel
from rig.gui.habits import Habits
from rig.gui.pages.mismatch import MismatchPage
from rig.gui.pages.protocol import ProtocolPage
from rig.gui.pages.trials import TrialsPage
from rig.gui.worker import Worker

PAGES: dict[str, Callable[[Worker, Habits], QWidget]] = {
    "trials": TrialsPage,
    "protocol": ProtocolPage,
    "mismatch": MismatchPage,
    "fit panel": FitPanel,
}


@pytest.fixture(params=PAGES, ids=list(PAGES))
def page(request: pytest.FixtureRequest, worker: Worker, habits: Habits, qtbot: QtBot) -> QWidget:
    page = PAGES[request.param](worker, habits)
    qtbot.addWidget(page)
    page.resize(1276, 690)
    with qtbot.waitExposed(page):
        page.show()
    return page


def test_whatever_takes_the_focus_has_a_name(page: QWidget) -> None:
    kinds = (QAbstractButton, QComboBox, QLineEdit, QAbstractItemView)
    for widget in page.findChildren(QWidget):
        if isinstance(widget, kinds) and widget.focusPolicy() & Qt.FocusPolicy.TabFocus:
            popup = widget.window() is not page.window()  # the list of a combo box belongs to it
            named = widget.accessibleName() or (isinstance(widget, QAbstractButton) and widget.text())
            assert named or popup, f"{type(widget).__name__} of {type(page).__name__}"


def test_no_button_and_no_word_is_cut_off(page: QWidget) -> None:
    for widget in page.findChildren(QPushButton):
        if widget.isVisible():
            assert widget.width() >= widget.minimumSizeHint().width(), widget.text()
    for label in page.findChildren(QLabel):
        if (
            label.isVisible()
            and label.text()
            and not label.wordWrap()
            and label.property("role") != "heading"
        ):
            assert label.width() >= label.minimumSizeHint().width(), label.text()


def test_long_words_make_no_window_taller(page: QWidget) -> None:
    height = page.minimumSizeHint().height()
    for label in page.findChildren(QLabel):
        if label.wordWrap():
            label.setText("what was wrong with this file, and where, and what to do " * 6)
    assert page.minimumSizeHint().height() <= height + 5
    assert height <= 690


def test_no_key_is_one_of_the_windows(page: QWidget) -> None:
    taken = {key for _, key, _ in TABLE} | {"Esc"} | {f"Ctrl+{i}" for i in range(1, 10)}
    own = [shortcut.key().toString() for shortcut in page.findChildren(QShortcut)]
    assert len(own) == len(set(own))
    assert not taken & set(own)


def test_pages_that_are_opened_again_and_again_leave_nothing(
    worker: Worker, habits: Habits, qtbot: QtBot
) -> None:
    def round_trip() -> None:
        for make in PAGES.values():
            page = make(worker, habits)
            page.show()
            page.hide()
            worker.forget("preview")  # its answer would be for a page that is gone
            page.deleteLater()
        for _ in range(3):
            QApplication.sendPostedEvents(None, 52)  # QEvent.DeferredDelete
            QApplication.processEvents()
        gc.collect()

    for _ in range(3):
        round_trip()
    widgets, rss = len(QApplication.allWidgets()), psutil.Process().memory_info().rss
    for _ in range(8):
        round_trip()
    assert len(QApplication.allWidgets()) <= widgets
    assert psutil.Process().memory_info().rss - rss < 20e6


def test_pictures_are_made_by_a_command(study_folder: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "rig.gui.page_screenshots", tmp_path, "--trials", study_folder]
    subprocess.run(command, check=True, env={**os.environ}, timeout=300, capture_output=True)
    names = {path.stem for path in tmp_path.glob("*.png")}
    for name in ("trials-overlay", "trials-fit-discard", "protocol", "protocol-faults", "mismatch-empty"):
        assert {f"{name}-light", f"{name}-dark"} <= names
