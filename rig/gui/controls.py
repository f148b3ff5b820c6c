"""The window's buttons, choices and lines of words, made the same way everywhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QComboBox, QLabel, QPushButton, QSizePolicy


def button(
    text: str, clicked: Callable[[], object], *, tip: str, key: str = "", main: bool = False
) -> QPushButton:
    """Return a push button; ``key`` presses it wherever the focus is on its page."""
    made = QPushButton(text)
    made.setAccessibleName(text.replace("&", ""))
    made.setToolTip(f"{tip} ({key})" if key else tip)
    made.clicked.connect(lambda _=False: clicked())
    made.setProperty("main", main)
    if key:
        shortcut = QShortcut(QKeySequence(key), made)
        shortcut.setContext(Qt.ShortcutContext.WindowShortcut)
        shortcut.activated.connect(made.click)
    return made


def choice(name: str, items: Sequence[str], current: str, changed: Callable[[str], object]) -> QComboBox:
    """Return a combo box; one without the focus lets the wheel scroll the page instead of changing it."""
    made = _CalmComboBox()
    made.setAccessibleName(name)
    made.setToolTip(name)
    made.addItems(list(items))
    if current in items:
        made.setCurrentText(current)
    made.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
    made.currentTextChanged.connect(changed)
    return made


def words(text: str = "", role: str = "", *, wrap: bool = True) -> QLabel:
    """Return a label whose text can be selected; ``role`` is one of the style sheet's (bad, good, note, ...)."""
    made = _WrappedLabel() if wrap else QLabel()
    made.setWordWrap(wrap)
    made.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    if wrap:
        made.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
    say(made, text, role)
    return made


def say(label: QLabel, text: str, role: str = "") -> None:
    """Give a label other words, and the look of their role."""
    label.setText(text)
    if label.property("role") != role:
        label.setProperty("role", role)
        label.style().unpolish(label)
        label.style().polish(label)


class _WrappedLabel(QLabel):
    """A label of several lines that makes no window taller: Qt would ask for the height at the least width."""

    def minimumSizeHint(self) -> QSize:  # noqa: N802
        """One line."""
        return QSize(60, self.fontMetrics().height())


class _CalmComboBox(QComboBox):
    def wheelEvent(self, event: object) -> None:  # noqa: N802
        if self.hasFocus():
            super().wheelEvent(event)  # type: ignore[arg-type]
        else:
            event.ignore()  # type: ignore[attr-defined]
