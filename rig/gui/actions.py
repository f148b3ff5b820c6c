"""Everything that can be asked for by a key or a button, in one table: the list of keys is made from it too."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QWidget

TABLE: tuple[tuple[str, str, str], ...] = (
    ("Start", "F5", "start the study that is shown, or go on with it"),
    ("Stop", "Shift+F5", "end the run; it can be gone on with later"),
    ("Pause", "Ctrl+Space", "go on no further than the end of this trial"),
    ("Go on", "Ctrl+Shift+Space", "end the pause"),
    ("Skip rest", "Ctrl+K", "end this rest now; the file says how long the finger did rest"),
    ("Retreat", "Ctrl+Backspace", "end this trial, take the arm off the skin, and pause"),
    ("Repeat", "Ctrl+R", "record the chosen trial again, next, at a new site"),
    ("Discard", "Ctrl+D", "mark the chosen trial as no good; its file stays"),
    ("Open rig ...", "Ctrl+Shift+O", "connect a rig by its rig file"),
    ("Simulated rig", "Ctrl+Shift+S", "connect the simulated rig"),
    ("Light or dark", "Ctrl+L", "change between the light and the dark look"),
    ("Reset layout", "Ctrl+0", "put everything where it was on the first day"),
    ("Keys", "F1", "list all keys"),
    ("Quit", "Ctrl+Q", "close the window"),
)


def make_actions(parent: QWidget, does: Mapping[str, Callable[[], object]]) -> dict[str, QAction]:
    """Return the actions of the table by name, each heard anywhere in the window."""
    made = {}
    for name, key, tip in TABLE:
        action = QAction(name, parent)
        action.setIconText(name)
        action.setShortcut(QKeySequence(key))
        action.setShortcutContext(Qt.ShortcutContext.ApplicationShortcut)
        action.setToolTip(f"{tip} ({key})")
        action.triggered.connect(lambda _=False, run=does[name]: run())
        parent.addAction(action)
        made[name] = action
    return made


def page_actions(parent: QWidget, names: list[str], show: Callable[[str], object]) -> dict[str, QAction]:
    """Return one action a page: Ctrl+1 and so on."""
    made = {}
    for i, name in enumerate(names, start=1):
        action = QAction(f"Page {name}", parent)
        action.setShortcut(QKeySequence(f"Ctrl+{i}"))
        action.setShortcutContext(Qt.ShortcutContext.ApplicationShortcut)
        action.setToolTip(f"page {name} (Ctrl+{i})")
        action.triggered.connect(lambda _=False, name=name: show(name))
        parent.addAction(action)
        made[action.text()] = action
    return made
