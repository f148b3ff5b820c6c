"""Many trials in one plot: a curve item a colour, the chosen trial on top."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import QVBoxLayout, QWidget

from rig.gui.jobs.traces import Axes, Trace
from rig.gui.theme import LIGHT, Theme, restyle_plot

_ZOOM_REST_MS = 150
_NEAR_PX = 30.0


@dataclass(frozen=True, slots=True)
class _Drawn:
    trace: Trace
    group: str


class TrialPlot(QWidget):
    """Overlays traces, coloured by group.

    `span_asked` gives the stretch of the abscissa that is looked at, when it has changed and rested: a finer
    cut of the data can then be shown. `picked` gives the file of a curve that was clicked.
    """

    span_asked = Signal(float, float)
    picked = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self._theme = LIGHT
        self._drawn: dict[str, _Drawn] = {}
        self._items: dict[str, pg.PlotCurveItem] = {}
        self._chosen = ""
        self._axes = Axes()
        self._whole: tuple[float, float] | None = None
        self.view = pg.PlotWidget()
        self.view.setAccessibleName("overlay of the chosen trials")
        self.view.setMenuEnabled(False)
        self._item = self.view.getPlotItem()
        self._item.addLegend(offset=(-8, 8))
        self._item.hideButtons()
        self._top = pg.PlotCurveItem(skipFiniteCheck=True)
        self._top.setZValue(10)
        self._item.addItem(self._top)
        self._rest = QTimer(self)
        self._rest.setSingleShot(True)
        self._rest.setInterval(_ZOOM_REST_MS)
        self._rest.timeout.connect(self._ask_span)
        self._item.vb.sigRangeChangedManually.connect(lambda *_: self._rest.start())
        self.view.scene().sigMouseClicked.connect(self._clicked)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.view)
        self.restyle(LIGHT)

    @property
    def shown(self) -> tuple[str, ...]:
        """The files that are drawn."""
        return tuple(self._drawn)

    @property
    def span(self) -> tuple[float, float] | None:
        """The stretch of the abscissa that was zoomed into, None where all is shown."""
        if self._whole is None:
            return None
        low, high = self._item.vb.viewRange()[0]
        inside = high - low < 0.98 * (self._whole[1] - self._whole[0])
        return (low, high) if inside else None

    def clear(self, axes: Axes, groups: Sequence[str] = ()) -> None:
        """Take all curves away, name the axes, and give the groups to come their colours, in this order."""
        self._axes = axes
        self._drawn = {}
        for item in self._items.values():
            self._item.removeItem(item)
        self._items = {}
        for group in dict.fromkeys(groups):
            item = self._items[group] = pg.PlotCurveItem(skipFiniteCheck=True, name=group)
            item.setPen(self._pen(group))
            self._item.addItem(item)
        self._top.setData([], [])
        (x_name, x_unit), (y_name, y_unit) = axes.labels
        self._item.setLabel("bottom", f"{x_name} ({x_unit})")
        self._item.setLabel("left", f"{y_name} ({y_unit})" if y_unit else f"{y_name}, {axes.scale}")

    def show_traces(self, traces: Sequence[Trace], groups: Sequence[str], *, fit_view: bool = True) -> None:
        """Draw traces, or draw them anew, each in the colour of its group."""
        changed = set()
        for trace, group in zip(traces, groups, strict=True):
            if trace.problem:
                continue
            self._drawn[trace.path] = _Drawn(trace, group)
            changed.add(group)
        for group in changed:
            self._draw_group(group)
        self.choose(self._chosen)
        if fit_view:
            self.show_all()

    def show_all(self) -> None:
        """Zoom out to all that is drawn."""
        limits = [limits for drawn in self._drawn.values() if (limits := _limits(drawn.trace))]
        if not limits:
            self._whole = None
            return
        x0, x1, y0, y1 = (
            pick(column) for pick, column in zip((min, max, min, max), zip(*limits, strict=True), strict=True)
        )
        self._whole = (x0, x1)
        self._item.vb.setRange(xRange=(x0, x1), yRange=(y0, y1), padding=0.03)

    def choose(self, path: str) -> None:
        """Draw one trial on top of the others."""
        self._chosen = path
        drawn = self._drawn.get(path)
        if drawn is None or len(self._drawn) < 2:
            self._top.setData([], [])
        else:
            self._top.setData(drawn.trace.x, drawn.trace.y)

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self._theme = theme
        restyle_plot(self.view, theme)
        for group, item in self._items.items():
            item.setPen(self._pen(group))
        self._top.setPen(pg.mkPen(theme.text, width=1))

    def _draw_group(self, group: str) -> None:
        members = [drawn.trace for drawn in self._drawn.values() if drawn.group == group]
        x = np.concatenate([trace.x for trace in members])
        y = np.concatenate([trace.y for trace in members])
        connect: NDArray[np.int32] = np.ones(len(x), dtype=np.int32)
        ends = np.cumsum([len(trace.x) for trace in members]) - 1
        connect[ends[ends >= 0]] = 0
        self._items[group].setData(x, y, connect=connect)

    def _pen(self, group: str) -> object:
        number = list(self._items).index(group)
        colours = self._theme.curves
        # a seventh group has a first one's colour, but is dashed
        style = pg.QtCore.Qt.PenStyle.SolidLine if number < len(colours) else pg.QtCore.Qt.PenStyle.DashLine
        return pg.mkPen(colours[number % len(colours)], width=1, style=style)

    def _ask_span(self) -> None:
        if self._axes.over_time and self._drawn:
            low, high = self._item.vb.viewRange()[0]
            self.span_asked.emit(low, high)

    def _clicked(self, event: object) -> None:
        """Pick the curve nearest to a click."""
        place = self._item.vb.mapSceneToView(event.scenePos())  # type: ignore[attr-defined]
        px, py = self._item.vb.viewPixelSize()
        nearest, at = "", _NEAR_PX**2
        for path, drawn in self._drawn.items():
            dx, dy = (drawn.trace.x - place.x()) / px, (drawn.trace.y - place.y()) / py
            distance = float(np.min(dx * dx + dy * dy, initial=np.inf))
            if distance < at:
                nearest, at = path, distance
        if nearest:
            self.picked.emit(nearest)


def _limits(trace: Trace) -> tuple[float, float, float, float] | None:
    if not len(trace.x):
        return None
    return float(trace.x.min()), float(trace.x.max()), float(trace.y.min()), float(trace.y.max())
