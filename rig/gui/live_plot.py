"""Position and force against time as they come: rolling or held still, peaks kept, phases shaded, limits drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QVBoxLayout, QWidget

from rig.engine.ring import TRIAL
from rig.gui.bench_link import BenchLink
from rig.gui.bench_state import BenchState
from rig.gui.bins import Trace, fine_trace
from rig.gui.live_marks import LimitLines, PhaseShade, phases_between
from rig.gui.theme import LIGHT, Theme, restyle_plot

SPANS_S = (1.0, 2.0, 5.0, 10.0, 30.0, 60.0, 300.0, 1800.0)
FINE_S = 6.0
"""Views no longer than this, and not older than the ring, are drawn from single samples."""

_RING_S = 58.0
_SHRINK_BELOW = 0.4
_NAMES_SHARE = 0.09
"""Of the axis's height, kept free of the curve at the top, where the phases' names stand."""

_LEAST = (0.05, 4.0)
"""The axes never show less than this, mm and mN: below it there is only noise."""


class LivePlot(QWidget):
    """Two plots over one time axis. While it rolls the axis stands still and the data move under it.

    Held still, it is panned and zoomed with the mouse, as far back as anything was kept. `view_changed` tells
    of a new span, or of being held or let go.
    """

    view_changed = Signal()

    def __init__(self, link: BenchLink) -> None:
        super().__init__()
        self._link = link
        self.span_s = 10.0
        self.frozen = False
        self.whole_trial = False
        self.in_volts = False
        self._auto = True
        self._theme = LIGHT
        self._ranges: list[tuple[float, float] | None] = [None, None]
        self._plots = [pg.PlotWidget(), pg.PlotWidget()]
        self._curves: list[Any] = []
        self._shades: list[PhaseShade] = []
        self._names: list[Any] = []
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(2)
        for plot, name in zip(self._plots, ("position", "force"), strict=True):
            self._prepare(plot, name)
            layout.addWidget(plot, 1)
        self._plots[1].setXLink(self._plots[0])
        self._plots[0].getAxis("bottom").setStyle(showValues=False)
        self._lines = LimitLines(*self._plots)
        self._titles()
        self.restyle(LIGHT)

    def freeze(self, on: bool | None = None) -> None:
        """Hold the view still, or let it roll again."""
        self.frozen = not self.frozen if on is None else on
        for plot in self._plots:
            plot.setMouseEnabled(x=self.frozen, y=self.frozen)
        bins = self._link.bins
        if self.frozen and bins is not None:
            rate_hz = self._rate_hz()
            newest_s = bins.next_sample / rate_hz
            self._plots[0].setXRange(newest_s - self._shown_span_s(), newest_s, padding=0)
        self._titles()
        self.redraw()
        self.view_changed.emit()

    def show_span(self, span_s: float) -> None:
        """Show so many seconds; 0: the whole trial, from its first sample on."""
        self.whole_trial = span_s == 0
        self.span_s = span_s or self.span_s
        if self.frozen:
            self.freeze(False)
        self._titles()
        self.redraw()
        self.view_changed.emit()

    def step_span(self, steps: int) -> None:
        """Show the next longer or shorter span."""
        nearest = int(np.argmin([abs(np.log(span / self.span_s)) for span in SPANS_S]))
        self.show_span(SPANS_S[int(np.clip(nearest + steps, 0, len(SPANS_S) - 1))])

    def autoscale(self) -> None:
        """Fit the axes to what is shown, and go on doing so."""
        self._auto, self._ranges = True, [None, None]
        self.redraw()

    def show_volts(self, on: bool) -> None:
        """Show the signals as sampled, or in mm and mN."""
        self.in_volts = on
        self._ranges = [None, None]
        self._titles()
        self.redraw()

    def show_state(self, state: BenchState) -> None:
        """Draw limits, threshold and surface as the bench has them."""
        self._lines.show(state, in_volts=self.in_volts)

    def redraw(self) -> None:
        """Draw what there is now; called at every frame while the page is seen."""
        bins, process = self._link.bins, self._link.process
        if bins is None or process is None or process.follower is None:
            return
        rate_hz, newest = self._rate_hz(), bins.next_sample
        if self.frozen:
            left_s, right_s = self._plots[0].viewRange()[0]
            start, stop, zero = int(left_s * rate_hz), int(np.ceil(right_s * rate_hz)), 0
        else:
            start, stop, zero = newest - round(self._shown_span_s() * rate_hz), newest, newest
            self._plots[0].setXRange(-self._shown_span_s(), 0, padding=0)
        pixels = max(int(self._plots[0].getViewBox().width()), 100)
        traces = self._traces(start, stop, pixels, newest)
        c = process.follower.ring.calibration
        constants = ((c.position_zero_v, c.volts_per_mm), (c.force_zero_v, c.volts_per_mn))
        for i, (trace, (zero_v, volts_per_unit)) in enumerate(zip(traces, constants, strict=True)):
            values = trace.values if self.in_volts else (trace.values - zero_v) / volts_per_unit
            gaps = bool(np.isnan(values).any())
            self._curves[i].setData(
                (trace.index - zero) / rate_hz, values, connect="finite" if gaps else "all"
            )
            self._scale(i, values)
        stretches = phases_between(self._link.marks, start, stop, newest)
        for shade in self._shades:
            shade.show([((a - zero) / rate_hz, (b - zero) / rate_hz, name) for a, b, name in stretches])

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self._theme = theme
        for plot, curve, shade, colour in zip(
            self._plots, self._curves, self._shades, theme.curves, strict=False
        ):
            restyle_plot(plot, theme)
            curve.setPen(pg.mkPen(colour, width=1))
            shade.restyle(theme)
        self._lines.restyle(theme)

    def _traces(self, start: int, stop: int, pixels: int, newest: int) -> list[Trace]:
        rate_hz = self._rate_hz()
        bins = self._link.bins
        assert bins is not None
        if stop - start <= FINE_S * rate_hz and start > newest - _RING_S * rate_hz:
            came = self._link.volts(max(start, 0))
            if came is not None:
                first, volts = came
                volts = volts[:, : max(stop - first, 0)]
                return [fine_trace(first, volts[i], pixels) for i in (0, 1)]
        return [bins.trace(i, start, stop, pixels) for i in (0, 1)]

    def _shown_span_s(self) -> float:
        bins = self._link.bins
        if not self.whole_trial or bins is None:
            return self.span_s
        began = [mark.index for mark in self._link.marks if mark.name == TRIAL]
        first = max(began[-1] if began else 0, bins.first_sample)
        return max((bins.next_sample - first) / self._rate_hz(), 1.0)

    def _rate_hz(self) -> float:
        process = self._link.process
        return process.follower.ring.sample_rate_hz if process is not None and process.follower else 8000.0

    def _scale(self, i: int, values: np.ndarray[Any, Any]) -> None:
        """Let the axis hold the data: wider at once, narrower only when much of it is empty."""
        known = values[np.isfinite(values)]  # the rest is a gap
        if not self._auto or self.frozen or not len(known):
            return
        low, high = float(known.min()), float(known.max())
        least = _LEAST[i] * (0.02 if self.in_volts else 1.0)
        shown = self._ranges[i]
        needed = max(high - low, least)
        height = 0.0 if shown is None else shown[1] - shown[0]
        if shown is not None and shown[0] <= low and high <= shown[1] - _NAMES_SHARE * height:
            if needed > _SHRINK_BELOW * height:
                return
            if height <= 1.5 * least:
                return
        middle = (low + high) / 2
        below, above = middle - 0.6 * needed, middle + 0.7 * needed
        self._ranges[i] = (below, above)
        self._plots[i].setYRange(below, above, padding=0)

    def _prepare(self, plot: Any, name: str) -> None:
        plot.setMenuEnabled(False)
        plot.hideButtons()
        plot.setMouseEnabled(x=False, y=False)
        plot.setAccessibleName(f"{name} against time")
        plot.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        plot.getAxis("left").setWidth(58)
        plot.viewport().setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        shade = PhaseShade()
        curve = pg.PlotCurveItem(skipFiniteCheck=False)
        plot.addItem(shade)
        plot.addItem(curve)
        self._shades.append(shade)
        self._curves.append(curve)

    def _titles(self) -> None:
        units = ("V", "V") if self.in_volts else ("mm", "mN")
        for plot, name, unit in zip(self._plots, ("position", "force"), units, strict=True):
            plot.setLabel("left", f"{name} ({unit})")
        axis = "time since connected (s), held still" if self.frozen else "time before now (s)"
        self._plots[1].setLabel("bottom", axis)

    def wheelEvent(self, event: Any) -> None:  # noqa: N802
        """While it rolls, the wheel changes the span."""
        if self.frozen:
            super().wheelEvent(event)
        else:
            self.step_span(-1 if event.angleDelta().y() > 0 else 1)
            event.accept()
