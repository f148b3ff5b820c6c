"""Keys that must work whatever has the focus: Esc takes the arm off the skin, Enter answers the bench."""

from __future__ import annotations

import time
from collections.abc import Callable

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import (
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QLineEdit,
    QPlainTextEdit,
    QTextEdit,
)

_SETTLED_S = 0.6
"""A question is not answered by a key that was on its way when it came up."""

_FIELDS = (QLineEdit, QAbstractSpinBox, QComboBox, QPlainTextEdit, QTextEdit)


class KeyFilter(QObject):
    """Sees every key of the program before any widget does; a shortcut would miss menus, fields and dialogs.

    ``running`` says whether Esc is the arm's (else it keeps its usual sense), ``asked`` whether a question
    stands, and since when.
    """

    def __init__(
        self,
        *,
        running: Callable[[], bool],
        abort: Callable[[], None],
        asked: Callable[[], float | None],
        answer: Callable[[], None],
    ) -> None:
        super().__init__()
        self._running = running
        self._abort = abort
        self._asked = asked
        self._answer = answer

    def eventFilter(self, _watched: QObject, event: QEvent) -> bool:  # noqa: N802
        """Take Esc and Enter where they are meant for the bench."""
        kind = event.type()
        if kind not in {QEvent.Type.KeyPress, QEvent.Type.ShortcutOverride} or not isinstance(
            event, QKeyEvent
        ):
            return False
        if event.key() == Qt.Key.Key_Escape and self._running():
            # of the two events of one key a menu or a field may take the first for itself: both abort
            if not event.isAutoRepeat():
                self._abort()
            event.accept()
            return True
        if kind is QEvent.Type.KeyPress and event.key() in {Qt.Key.Key_Return, Qt.Key.Key_Enter}:
            since = self._asked()
            settled = since is not None and time.monotonic() - since > _SETTLED_S
            plain = event.modifiers() in {Qt.KeyboardModifier.NoModifier, Qt.KeyboardModifier.KeypadModifier}
            if settled and plain and not self._in_a_field():
                self._answer()
                return True
        return False

    @staticmethod
    def _in_a_field() -> bool:
        if QApplication.activePopupWidget() or QApplication.activeModalWidget():
            return True
        return isinstance(QApplication.focusWidget(), _FIELDS)
