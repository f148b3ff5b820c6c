"""A line that asks why a trial is to be discarded; the reason is kept with the trial."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QPushButton, QSizePolicy, QWidget

from rig.gui.shortened import ShortenedLabel

REASONS = ("the finger moved", "the finger slipped", "wrong place", "bad contact", "talked or laughed")


class DiscardBar(QWidget):
    """Hidden until asked; `confirmed` gives the file and the reason."""

    confirmed = Signal(Path, str)
    said = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self._file = Path()
        self._label = ShortenedLabel()
        self.reason = QComboBox()
        self.reason.setEditable(True)
        self.reason.addItems(list(REASONS))
        self.reason.setAccessibleName("reason for discarding the trial")
        discard, leave = QPushButton("Discard"), QPushButton("Leave it")
        discard.setToolTip("mark it; its file stays, and Keep after all takes it back (Enter)")
        leave.setToolTip("the trial stays as it is")
        discard.clicked.connect(self._confirm)
        leave.clicked.connect(self.hide)
        field = self.reason.lineEdit()
        assert field is not None, "the box can be edited"
        self.field = field
        self.field.returnPressed.connect(self._confirm)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        # one's own reason may be longer than all that are offered: it scrolls in its field
        self.reason.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Fixed)
        layout.addWidget(self._label, 1)
        layout.addWidget(self.reason)
        layout.addWidget(discard)
        layout.addWidget(leave)
        self.hide()

    def ask(self, file: Path) -> None:
        """Ask for the reason to discard a file."""
        self._file = file
        self._label.setText(f"Discard {file.name}, because")
        self.show()
        self.reason.setFocus()
        self.field.selectAll()

    def _confirm(self) -> None:
        reason = self.reason.currentText().strip()
        if not reason:
            self.said.emit("discard: give a reason, it is kept with the trial")
            return
        self.hide()
        self.confirmed.emit(self._file, reason)
