"""Which words of a window can't be read because their place is too small for them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QAbstractButton, QComboBox, QHeaderView, QLabel, QTabBar, QWidget

from rig.gui.shortened import ShortenedLabel

_SLACK_PX = 1


def cut_off(root: QWidget) -> list[str]:
    """Return, in words, each text that is seen below ``root`` and does not fit: empty where all can be read.

    Labels that shorten their text on purpose are left out: their tool tip holds the whole.
    """
    found = []
    for widget in root.findChildren(QWidget):
        if not widget.isVisibleTo(root):
            continue
        for text, needs, has in _texts(widget):
            if needs > has + _SLACK_PX:
                found.append(f"{type(widget).__name__} {text!r} needs {needs} of {has} px")
    return found


def _texts(widget: QWidget) -> Iterator[tuple[str, int, int]]:
    """Yield each text of a widget with the pixels it needs and has, across or down, whichever it lacks."""
    if isinstance(widget, ShortenedLabel):
        return
    if isinstance(widget, QLabel):
        yield from _of_label(widget)
    elif isinstance(widget, QAbstractButton) and widget.text():
        yield widget.text(), widget.minimumSizeHint().width(), widget.width()
    elif isinstance(widget, QComboBox):
        yield widget.currentText(), _combo_width(widget), widget.width()
    elif isinstance(widget, QTabBar):
        for i in range(widget.count()):
            yield widget.tabText(i), widget.tabSizeHint(i).width(), widget.tabRect(i).width()
    elif isinstance(widget, QHeaderView) and widget.orientation() == Qt.Orientation.Horizontal:
        model: Any = widget.model()
        for i in range(widget.count() if model is not None else 0):
            if not widget.isSectionHidden(i):
                title = str(model.headerData(i, Qt.Orientation.Horizontal))
                yield title, widget.fontMetrics().horizontalAdvance(title), widget.sectionSize(i)


def _of_label(label: QLabel) -> Iterator[tuple[str, int, int]]:
    if not label.text() or not label.pixmap().isNull():
        return
    if not label.wordWrap():
        yield label.text(), label.sizeHint().width(), label.width()
        return
    inside = label.contentsRect()
    flags = Qt.TextFlag.TextWordWrap | Qt.AlignmentFlag.AlignLeft
    needed = label.fontMetrics().boundingRect(0, 0, inside.width(), 100_000, flags, label.text())
    yield label.text(), needed.width(), inside.width()
    yield label.text(), needed.height(), inside.height()


def _combo_width(combo: QComboBox) -> int:
    """Return the width at which a combo box shows the item it stands at."""
    widest = max(combo.fontMetrics().horizontalAdvance(combo.itemText(i)) for i in range(combo.count() or 1))
    room = combo.sizeHint().width() - widest
    return room + combo.fontMetrics().horizontalAdvance(combo.currentText())
