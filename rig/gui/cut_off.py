"""Which words of a window can't be read because their place is too small for them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QAbstractButton,
    QComboBox,
    QHeaderView,
    QLabel,
    QScrollArea,
    QStyle,
    QTabBar,
    QTableWidget,
    QWidget,
)

from rig.gui.shortened import ShortenedLabel

_SLACK_PX = 1


def cut_off(root: QWidget) -> list[str]:
    """Return, in words, each text that is seen below ``root`` and does not fit: empty where all can be read.

    Labels and boxes that shorten their text on purpose, and long lists (`QTableView`), are left out: a tool
    tip holds the whole there.
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
    match widget:
        case ShortenedLabel():
            return
        case QLabel():
            yield from _of_label(widget)
        case pg.PlotWidget():
            yield from _of_axes(widget)
        case QAbstractButton() if widget.text():
            yield widget.text(), widget.minimumSizeHint().width(), widget.width()
        case QTableWidget():
            yield from _of_cells(widget)
        case QScrollArea():
            inside = widget.widget()
            if inside and widget.horizontalScrollBarPolicy() == Qt.ScrollBarPolicy.ScrollBarAlwaysOff:
                yield widget.accessibleName(), inside.width(), widget.viewport().width()
        case QComboBox():
            if widget.sizeAdjustPolicy() != QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon:
                yield widget.currentText(), _combo_width(widget), widget.width()
        case QTabBar():
            for i in range(widget.count()):
                yield widget.tabText(i), widget.tabSizeHint(i).width(), widget.tabRect(i).width()
        case QHeaderView() if widget.orientation() == Qt.Orientation.Horizontal:
            yield from _of_headings(widget)


def _of_headings(header: QHeaderView) -> Iterator[tuple[str, int, int]]:
    model: Any = header.model()
    for i in range(header.count() if model is not None else 0):
        if not header.isSectionHidden(i):
            title = str(model.headerData(i, Qt.Orientation.Horizontal))
            yield title, header.fontMetrics().horizontalAdvance(title), header.sectionSize(i)


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


def _of_cells(table: QTableWidget) -> Iterator[tuple[str, int, int]]:
    margin = 2 * (table.style().pixelMetric(QStyle.PixelMetric.PM_FocusFrameHMargin) + 1)
    for row in range(table.rowCount()):
        for column in range(table.columnCount()):
            item = table.item(row, column)
            if item is not None and item.text():
                needed = table.fontMetrics().horizontalAdvance(item.text())
                yield item.text(), needed, table.columnWidth(column) - margin


def _of_axes(plot: pg.PlotWidget) -> Iterator[tuple[str, int, int]]:
    for side in ("left", "bottom"):
        axis = plot.getAxis(side)
        if axis.isVisible() and axis.label.isVisible():
            room = axis.size().height() if side == "left" else axis.size().width()
            yield axis.labelText, round(axis.label.boundingRect().width()), round(room)


def _combo_width(combo: QComboBox) -> int:
    """Return the width at which a combo box shows the item it stands at."""
    widest = max(combo.fontMetrics().horizontalAdvance(combo.itemText(i)) for i in range(combo.count() or 1))
    room = combo.sizeHint().width() - widest
    return room + combo.fontMetrics().horizontalAdvance(combo.currentText())
