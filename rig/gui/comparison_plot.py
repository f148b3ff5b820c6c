"""Recording and simulation over each other, what each simulation leaves, and where it lies."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QCheckBox, QComboBox, QHBoxLayout, QVBoxLayout, QWidget

from rig.gui.controls import choice, say, words
from rig.gui.jobs.comparing import Comparison, Offer
from rig.gui.jobs.report_file import Window
from rig.gui.theme import LIGHT, Theme, legend_below, restyle_plot

_EMPTY = "A trial appears here beside its simulation when a diagnosis is open."
_CLOSE_UP_S = 0.3
"""Shown on each side of a window that is looked at."""

_EVERYWHERE = 0.8
"""A window of more than this share of the trial marks no place in it."""


class ComparisonPlot(QWidget):
    """One trial at a time; `trial_asked` gives the file that is to be compared."""

    trial_asked = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self._theme = LIGHT
        self._comparison: Comparison | None = None
        self._windows: tuple[Window, ...] = ()
        self._marks: list[pg.GraphicsObject] = []
        self._paths: tuple[str, ...] = ()
        self._offer = Offer((), {})
        self._which = choice("which trial", (), "", lambda _: self._ask())
        # a trial's name is as long as its study liked: the tool tip holds the whole
        self._which.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self._which.setMinimumContentsLength(16)
        self._after_box = QCheckBox("show what the simulation with the missing physics leaves")
        self._after_box.setChecked(True)
        self._after_box.toggled.connect(lambda _: self._draw())
        self._note = words(_EMPTY, "faint")
        self.force, self.residual = pg.PlotWidget(), pg.PlotWidget()
        for plot, name in ((self.force, "recorded and simulated force"), (self.residual, "what is left")):
            plot.setMenuEnabled(False)
            plot.setAccessibleName(name)
            plot.hideButtons()
            plot.getAxis("left").setWidth(56)
        self.force.setLabel("left", "force (mN)")
        legend_below(self.force)
        self.residual.setLabel("left", "left (mN)")
        self.residual.setLabel("bottom", "time from the trial's first sample (s)")
        self.residual.setXLink(self.force)
        self._recorded = self.force.plot(name="recorded")
        self._before = self.force.plot(name="simulation before")
        self._after = self.force.plot(name="simulation after")
        self._left_before = self.residual.plot()
        self._left_after = self.residual.plot()
        self._zero = pg.InfiniteLine(0.0, angle=0)
        self.residual.addItem(self._zero)
        bar = QHBoxLayout()
        bar.addWidget(self._which, 1)
        bar.addWidget(self._after_box)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(4, 4, 4, 4)
        layout.addLayout(bar)
        layout.addWidget(self.force, 3)
        layout.addWidget(self.residual, 2)
        layout.addWidget(self._note)
        self.restyle(LIGHT)

    @property
    def shown(self) -> Comparison | None:
        """The trial that is drawn."""
        return self._comparison

    def offer(self, offer: Offer, windows: Sequence[Window]) -> None:
        """Offer trials to be compared, and ask for the first; ``windows`` are marked in each."""
        self._offer, self._paths, self._windows = offer, offer.paths, tuple(windows)
        self._comparison = None
        self._which.blockSignals(True)
        self._which.clear()
        self._which.addItems([Path(path).stem for path in offer.paths])
        self._which.blockSignals(False)
        self._draw()
        self._ask()

    def wait_for(self, what: str) -> None:
        """Show no trial, and say what is being done meanwhile."""
        self._paths, self._comparison = (), None
        self._draw()
        say(self._note, what, "faint")

    def show_comparison(self, comparison: Comparison) -> None:
        """Draw a trial."""
        self._comparison = comparison
        self._draw()
        self.force.autoRange()
        self._fit_residual()

    def show_problem(self, problem: str) -> None:
        """Say why there is nothing to draw."""
        self._comparison = None
        self._draw()
        say(self._note, problem, "bad")

    def look_at(self, window: Window) -> None:
        """Zoom to a window, where it lies in the trial that is shown."""
        start_s, stop_s = self._place(window)
        self.force.setXRange(start_s - _CLOSE_UP_S, stop_s + _CLOSE_UP_S, padding=0)
        self._fit_residual()

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self._theme = theme
        for plot in (self.force, self.residual):
            restyle_plot(plot, theme)
        before, after = theme.curves[1], theme.curves[0]
        self._recorded.setPen(pg.mkPen(theme.line, width=4))
        self._before.setPen(pg.mkPen(before, width=1, style=Qt.PenStyle.DashLine))
        self._after.setPen(pg.mkPen(after, width=1))
        self._left_before.setPen(pg.mkPen(before, width=1))
        self._left_after.setPen(pg.mkPen(after, width=1))
        self._zero.setPen(pg.mkPen(theme.text, width=1))
        self._draw()

    def _ask(self) -> None:
        at = self._which.currentIndex()
        if 0 <= at < len(self._paths):
            self._which.setToolTip(f"which trial\n{self._paths[at]}")
            say(self._note, "simulating ...", "faint")
            self.trial_asked.emit(self._paths[at])

    def _draw(self) -> None:
        for plot, mark in self._marked():
            plot.removeItem(mark)
        self._marks = []
        found = self._comparison
        curves = (self._recorded, self._before, self._after, self._left_before, self._left_after)
        if found is None:
            for curve in curves:
                curve.setData([], [])
            if not self._paths:
                say(self._note, _EMPTY, "faint")
            return
        t, after = found.time_s, self._after_box.isChecked()
        self._recorded.setData(t, found.recorded_mn)
        self._before.setData(t, found.before_mn, connect="finite")
        self._after.setData(t, found.after_mn if after else np.full(len(t), np.nan), connect="finite")
        self._left_before.setData(t, found.recorded_mn - found.before_mn, connect="finite")
        left = found.recorded_mn - found.after_mn if after else np.full(len(t), np.nan)
        self._left_after.setData(t, left, connect="finite")
        self._mark_windows()
        text = f"left before {found.rms_before_mn:.3f} mN rms, after {found.rms_after_mn:.3f} mN rms"
        text += "; contact, offset and stiffnesses are fitted to this trial"
        if found.left_out:
            text += f". Not in the line after: {'; '.join(found.left_out)}"
        say(self._note, text, "faint")

    def _mark_windows(self) -> None:
        colour = pg.mkColor(self._theme.curves[1])
        colour.setAlpha(45)
        whole_s = float(self._comparison.time_s[-1]) if self._comparison is not None else 0.0
        for number, window in enumerate(self._windows, start=1):
            if window.stop_s - window.start_s > _EVERYWHERE * whole_s:
                continue
            region = pg.LinearRegionItem(self._place(window), movable=False, pen=pg.mkPen(None))
            region.setBrush(pg.mkBrush(colour))
            region.setZValue(-10)
            self.residual.addItem(region)
            name = pg.InfLineLabel(region.lines[0], str(number), position=0.92, color=self._theme.text)
            name.setParentItem(region.lines[0])
            self._marks.append(region)

    def _place(self, window: Window) -> tuple[float, float]:
        """Return a window's stretch in this trial, whose phases begin sooner or later than in the median."""
        own = self._comparison.phase_starts_s if self._comparison is not None else {}
        usual = self._offer.phase_starts_s
        shift_s = own.get(window.phase, 0.0) - usual.get(window.phase, 0.0) if window.phase in own else 0.0
        return window.start_s + shift_s, window.stop_s + shift_s

    def _marked(self) -> list[tuple[pg.PlotWidget, pg.GraphicsObject]]:
        return [(self.residual, mark) for mark in self._marks]

    def _fit_residual(self) -> None:
        """Show all of what is left within the stretch of time that is looked at."""
        found = self._comparison
        if found is None:
            return
        low, high = self.force.getPlotItem().vb.viewRange()[0]
        inside = (found.time_s >= low) & (found.time_s <= high) & np.isfinite(found.before_mn)
        if inside.any():
            left = np.concatenate(
                [(found.recorded_mn - line)[inside] for line in (found.before_mn, found.after_mn)]
            )
            self.residual.setYRange(float(left.min()), float(left.max()), padding=0.08)
