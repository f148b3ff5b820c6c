"""A question in a line of its own at the head of a page; never a dialog, so that Abort stays in reach."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from PySide6.QtCore import Qt
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QFrame, QHBoxLayout, QPushButton

from rig.gui.controls import say, words

Answer = tuple[str, Callable[[], object]]


class Banner(QFrame):
    """Hidden until something is asked; every answer hides it again."""

    def __init__(self) -> None:
        super().__init__()
        self.setFrameShape(QFrame.Shape.StyledPanel)
        self._words = words("", "note")
        self._row = QHBoxLayout(self)
        self._row.addWidget(self._words, 1)
        self._buttons: list[QPushButton] = []
        self.hide()

    @property
    def text(self) -> str:
        """What is asked."""
        return self._words.text()

    def ask(self, text: str, answers: Sequence[Answer], role: str = "note") -> None:
        """Ask; the first answer has the focus, the last one is also what the Esc key gives."""
        self.drop()
        say(self._words, text, role)
        for name, then in answers:
            made = QPushButton(name)
            made.setAccessibleName(name)
            made.clicked.connect(lambda _=False, then=then: self._answered(then))
            self._row.addWidget(made)
            self._buttons.append(made)
        self.show()
        if self._buttons:
            self._buttons[0].setProperty("main", True)
            self._buttons[0].setFocus()

    def drop(self) -> None:
        """Take the question back."""
        self.hide()
        for made in self._buttons:
            self._row.removeWidget(made)
            made.deleteLater()
        self._buttons = []

    def answer(self, name: str) -> None:
        """Press the answer of that name."""
        next(made for made in self._buttons if made.text() == name).click()

    def keyPressEvent(self, event: QKeyEvent) -> None:  # noqa: N802
        """Esc gives the last answer."""
        if event.key() == Qt.Key.Key_Escape and self._buttons:
            self._buttons[-1].click()
        else:
            super().keyPressEvent(event)

    def _answered(self, then: Callable[[], object]) -> None:
        self.drop()
        then()
