"""What lies behind and across the live curves: phases as shaded grounds, limits and threshold as lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter

from rig.engine.ring import END, IDLE, TRIAL, Mark
from rig.gui.bench_state import BenchState
from rig.gui.theme import LIGHT, Theme


def phases_between(marks: Sequence[Mark], start: int, stop: int, newest: int) -> list[tuple[int, int, str]]:
    """Return the phases that lie between two samples: first sample, the one after the last, name."""
    if not marks:
        return []
    ends = [*(mark.index for mark in marks[1:]), newest]
    return [
        (mark.index, end, mark.name)
        for mark, end in zip(marks, ends, strict=True)
        if mark.name not in {TRIAL, END, IDLE} and mark.index < stop and end > start and end > mark.index
    ]


class PhaseShade(pg.GraphicsObject):  # type: ignore[misc]
    """The grounds behind a trial's phases, with their names at the top."""

    def __init__(self) -> None:
        super().__init__()
        self._stretches: list[tuple[float, float, str]] = []
        self._theme = LIGHT
        self.setZValue(-100)

    def show(self, stretches: list[tuple[float, float, str]]) -> None:
        """Show these: from, to, name; in the plot's own x."""
        if stretches != self._stretches:
            self._stretches = stretches
            self.update()

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self._theme = theme
        self.update()

    def boundingRect(self) -> QRectF:  # noqa: N802
        """All that is seen: the grounds reach from edge to edge."""
        return QRectF(self.viewRect())

    def dataBounds(self, *_: object, **__: object) -> None:  # noqa: N802
        """The grounds have no say in the axes' ranges."""
        return

    def viewRangeChanged(self) -> None:  # noqa: N802
        """The view is another one."""
        self.prepareGeometryChange()

    def paint(self, painter: QPainter, *_: object) -> None:
        """Paint the grounds, then the names, which are not scaled with the data."""
        view = self.viewRect()
        for left, right, name in self._stretches:
            ground = QRectF(left, view.top(), right - left, view.height()).intersected(QRectF(view))
            painter.fillRect(ground, QColor(self._theme.phase(name)))
        transform = painter.transform()
        painter.resetTransform()
        painter.setPen(QColor(self._theme.faint))
        height = painter.fontMetrics().height()
        for left, right, name in self._stretches:
            a = transform.map(QPointF(max(left, view.left()), 0)).x()
            b = transform.map(QPointF(min(right, view.right()), 0)).x()
            if b - a > painter.fontMetrics().horizontalAdvance(name) + 6:
                top = min(
                    transform.map(QPointF(0, view.top())).y(), transform.map(QPointF(0, view.bottom())).y()
                )
                painter.drawText(QPointF(a + 4, top + height), name)


class LimitLines:
    """Limits, threshold and surface, as lines across the plots."""

    def __init__(self, position: Any, force: Any) -> None:
        self._made: dict[str, Any] = {}
        self._meant: dict[str, bool] = {}
        for plot, names in (
            (position, ("travel limit", "travel limit ", "surface")),
            (force, ("force limit", "force limit ", "threshold")),
        ):
            for name in names:
                line = pg.InfiniteLine(
                    angle=0, label=name.strip(), labelOpts={"position": 0.06, "anchors": [(0, 1), (0, 1)]}
                )
                line.hide()
                plot.addItem(line, ignoreBounds=True)
                self._made[name] = line
            plot.getViewBox().sigYRangeChanged.connect(self._hide_what_is_out_of_view)

    def show(self, state: BenchState, *, in_volts: bool) -> None:
        """Put the lines where the bench has them; over volts there are none."""
        snapshot, bench = state.snapshot, state.snapshot.bench
        values: dict[str, float | None] = {
            "travel limit": bench.travel_max_mm if bench else None,
            "travel limit ": bench.travel_min_mm if bench else None,
            "force limit": bench.force_max_mn if bench else None,
            "force limit ": -bench.force_max_mn if bench else None,
            "surface": snapshot.surface_mm,
            "threshold": snapshot.threshold_mn if state.running else None,
        }
        for name, value in values.items():
            line = self._made[name]
            self._meant[name] = value is not None and not in_volts
            if value is not None and line.value() != value:
                line.setValue(value)
        self._hide_what_is_out_of_view()

    def _hide_what_is_out_of_view(self, *_: object) -> None:
        """A line just below the view would leave the upper half of its name in it."""
        for name, line in self._made.items():
            view = line.getViewBox()
            low, high = view.viewRange()[1] if view is not None else (0.0, 0.0)
            line.setVisible(self._meant.get(name, False) and low <= line.value() <= high)

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        for name, line in self._made.items():
            colour = theme.bad if "limit" in name else theme.note
            style = Qt.PenStyle.DashLine if "limit" in name else Qt.PenStyle.DotLine
            line.setPen(pg.mkPen(colour, width=1, style=style))
            line.label.setColor(colour)
