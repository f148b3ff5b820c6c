"""The form of a protocol: a line a value, its unit beside it, what is wrong with it below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QGridLayout,
    QGroupBox,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QScrollArea,
    QVBoxLayout,
    QWidget,
)

from rig.gui.controls import choice, say, words
from rig.gui.form_fields import Field, shown
from rig.gui.protocol_draft import ProtocolDraft, fault_of

_TITLES = {
    "": "Protocol",
    "study": "Study",
    "specimen": "Specimen",
    "surface": "Finding the surface",
    "indentation": "Indentation",
}
_NOT_SET = "not set"


class ProtocolForm(QScrollArea):
    """Edits one draft; `changed` after every change."""

    changed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.setWidgetResizable(True)
        self.setAccessibleName("values of the protocol")
        self.lines: dict[str, FieldLine] = {}
        self._draft: ProtocolDraft | None = None

    def edit(self, draft: ProtocolDraft) -> None:
        """Show a draft; from now on what is typed goes into it."""
        self._draft = draft
        self.lines = {}
        inside = QWidget()
        column = QVBoxLayout(inside)
        column.setContentsMargins(2, 2, 8, 2)
        for table in dict.fromkeys(field.table for field in draft.fields):
            box = QGroupBox(_TITLES.get(table, table))
            grid = QGridLayout(box)
            grid.setColumnStretch(1, 1)
            grid.setColumnMinimumWidth(0, self.fontMetrics().horizontalAdvance("rigid target depths "))
            grid.setColumnMinimumWidth(2, self.fontMetrics().horizontalAdvance("mN/mm "))
            grid.setVerticalSpacing(3)
            for field in draft.fields:
                if field.table == table:
                    self._add(box, grid, field, draft)
            column.addWidget(box)
        column.addStretch(1)
        self.setWidget(inside)

    def show_faults(self, faults: Mapping[str, str]) -> list[str]:
        """Say below each value what is wrong with it; return what belongs to no value."""
        told = set()
        for line in self.lines.values():
            text = fault_of(line.field, faults)
            line.show_fault(text)
            told |= {fault for fault in faults.values() if text and fault.endswith(text)}
        return [text for text in faults.values() if text not in told]

    def _add(self, box: QGroupBox, grid: QGridLayout, field: Field, draft: ProtocolDraft) -> None:
        line = FieldLine(field, draft.value(field), box)
        row = grid.rowCount()
        name = QLabel(field.label)
        name.setToolTip(field.tip)
        name.setBuddy(line.editor)
        grid.addWidget(name, row, 0)
        grid.addWidget(line.editor, row, 1)
        grid.addWidget(QLabel(field.unit), row, 2)
        grid.addWidget(line.fault, row + 1, 1, 1, 2)
        line.edited.connect(lambda: self._take(line))
        self.lines[field.key] = line

    def _take(self, line: FieldLine) -> None:
        assert self._draft is not None
        self._draft.put(line.field, line.value())
        self.changed.emit()


class FieldLine(QObject):
    """The editor of one value; it holds whatever was typed, and never corrects it by itself."""

    edited = Signal()

    def __init__(self, field: Field, value: Any, parent: QObject) -> None:
        super().__init__(parent)
        self.field = field
        self._stated = value
        self._boxes: list[QCheckBox] = []
        self.editor = self._made(field, value)
        self.editor.setToolTip(field.tip)
        self.editor.setAccessibleName(f"{field.label}, {field.unit}" if field.unit else field.label)
        self.fault = words("", "bad")
        self.fault.hide()

    def value(self) -> Any:
        """Return what the file is to say: a number where one was typed, else the text as it stands."""
        if isinstance(self.editor, QComboBox):
            text = self.editor.currentText()
            return None if text == _NOT_SET else text
        if isinstance(self.editor, QCheckBox):
            checked = self.editor.isChecked()
            return None if self._stated is None and checked == self.field.default else checked
        if self._boxes:
            return self._several()
        assert isinstance(self.editor, QLineEdit)
        text = self.editor.text().strip()
        if not text and (self.field.editor != "text" or self._stated is None):
            return None
        return self._typed(text)

    def type_in(self, text: str) -> None:
        """Type a text into a value that is typed."""
        assert isinstance(self.editor, QLineEdit)
        self.editor.setText(text)
        self.edited.emit()

    def show_fault(self, text: str) -> None:
        """Say what is wrong, and mark the editor; nothing where the text is empty."""
        say(self.fault, text, "bad")
        self.fault.setVisible(bool(text))
        if bool(self.editor.property("faulty")) != bool(text):
            self.editor.setProperty("faulty", bool(text))
            self.editor.style().unpolish(self.editor)
            self.editor.style().polish(self.editor)

    def _made(self, field: Field, value: Any) -> QWidget:
        current = field.default if value is None else value
        if field.editor == "choice":
            items = ([_NOT_SET] if field.optional else []) + list(field.choices)
            return choice(field.label, items, str(current or _NOT_SET), lambda _: self.edited.emit())
        if field.editor == "yes or no":
            box = QCheckBox()
            box.setChecked(current is True)
            box.toggled.connect(lambda _: self.edited.emit())
            return box
        if field.editor == "several":
            return self._made_boxes(field.choices, current)
        line = QLineEdit(shown(value))
        line.setPlaceholderText(self._unstated(field))
        line.textEdited.connect(lambda _: self.edited.emit())
        return line

    def _made_boxes(self, choices: Sequence[str], current: Any) -> QWidget:
        holder = QWidget()
        row = QHBoxLayout(holder)
        row.setContentsMargins(0, 0, 0, 0)
        for name in choices:
            box = QCheckBox(name)
            box.setChecked(isinstance(current, list | tuple) and name in current)
            box.setAccessibleName(name)
            box.toggled.connect(lambda _: self.edited.emit())
            row.addWidget(box)
            self._boxes.append(box)
        row.addStretch(1)
        holder.setFocusProxy(self._boxes[0])
        return holder

    def _several(self) -> list[str]:
        chosen = [box.text() for box in self._boxes if box.isChecked()]
        stated = self._stated if isinstance(self._stated, list) else []
        # the file's own order counts: a study runs in it
        kept = [name for name in stated if name in chosen]
        return kept + [name for name in chosen if name not in kept]

    def _unstated(self, field: Field) -> str:
        if field.required:
            return "must be given"
        return shown(field.default) or _NOT_SET

    def _typed(self, text: str) -> Any:
        editor = self.field.editor
        if editor == "text":
            return text
        if editor in ("number", "whole"):
            return _number(text.replace(",", "."), whole=editor == "whole")
        numbers = [_number(part, whole=False) for part in text.replace(";", ",").replace(",", " ").split()]
        if editor == "number or two" and len(numbers) == 1:
            return numbers[0]
        return numbers


def _number(text: str, *, whole: bool) -> int | float | str:
    """Return the number that was typed; the text itself where it is none, so that its fault can be told."""
    try:
        return int(text) if whole else float(text)
    except ValueError:
        return text
