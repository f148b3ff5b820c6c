"""A line of words of any length that takes the room there is: the middle gives way, the tool tip holds all."""

from __future__ import annotations

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QPainter, QPaintEvent
from PySide6.QtWidgets import QLabel, QSizePolicy


class ShortenedLabel(QLabel):
    """One line. A common label asks for the width of its text, and a long path then widens the window.

    ``tip`` says what the words are; it stands in the tool tip above them.
    """

    def __init__(self, tip: str = "") -> None:
        super().__init__()
        self._tip = tip
        self.setToolTip(tip)
        self.setTextFormat(Qt.TextFormat.PlainText)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)

    def setText(self, text: str) -> None:  # noqa: N802
        """Take other words; more than one line becomes one."""
        line = " ".join(text.split())
        super().setText(line)
        self.setToolTip("\n".join(part for part in (self._tip, line) if part))

    def minimumSizeHint(self) -> QSize:  # noqa: N802
        """Room for a few letters, of one line's height."""
        return QSize(40, self.fontMetrics().height())

    def paintEvent(self, _: QPaintEvent) -> None:  # noqa: N802
        """Draw what fits."""
        inside = self.contentsRect()
        shown = self.fontMetrics().elidedText(self.text(), Qt.TextElideMode.ElideMiddle, inside.width())
        painter = QPainter(self)
        painter.setPen(self.palette().color(self.foregroundRole()))
        painter.drawText(inside, self.alignment(), shown)
