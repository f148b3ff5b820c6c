"""The planned motion against the rig's limits, drawn before anything moves."""

from __future__ import annotations

from datetime import datetime, timedelta

import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QVBoxLayout, QWidget

from rig.gui.controls import choice, say, words
from rig.gui.jobs.planning import PlannedMotion, Preview
from rig.gui.theme import LIGHT, Theme, restyle_plot
from rig.settings.rig_file import RigFile

_NAMED_SHARE = 0.06
"""Of the whole motion: a shorter phase has no room for its name."""
_EMPTY = "The motion appears here as soon as every value is one that can be run."


class MotionPreview(QWidget):
    """Shows one kind of trial of a plan at a time; the line of the skin can be moved with the mouse.

    `surface_moved` gives where it was moved to, mm in lever coordinates.
    """

    surface_moved = Signal(float)

    def __init__(self) -> None:
        super().__init__()
        self._theme = LIGHT
        self._preview: Preview | None = None
        self._rig = RigFile()
        self._grounds: list[pg.GraphicsObject] = []
        self._summary = words(_EMPTY, "faint")
        self._which = choice("which trial of the plan", (), "", lambda _: self._draw())
        self._beyond = words()
        self.view = pg.PlotWidget()
        self.view.setAccessibleName("planned motion")
        self.view.setMenuEnabled(False)
        self.view.hideButtons()
        self.view.invertY(True)
        self.view.setLabel("bottom", "time (s)")
        self.view.setLabel("left", "lever position (mm), down is into the skin")
        self._path = self.view.plot()
        self._limits = [
            pg.InfiniteLine(angle=0, label="travel ends", labelOpts={"position": 0.9}) for _ in (0, 1)
        ]
        self._safe = pg.InfiniteLine(angle=0, label="safe position", labelOpts={"position": 0.9})
        self._deepest = pg.InfiniteLine(
            angle=0, label="deepest that this rig may press", labelOpts={"position": 0.3}
        )
        self._skin = pg.InfiniteLine(angle=0, movable=True, label="skin, as assumed: move me")
        self._skin.label.setPosition(0.3)
        for line in (*self._limits, self._deepest, self._safe, self._skin):
            self.view.addItem(line)
        self._skin.sigPositionChangeFinished.connect(
            lambda line: self.surface_moved.emit(float(line.value()))
        )
        layout = QVBoxLayout(self)
        layout.setContentsMargins(4, 4, 4, 4)
        layout.addWidget(self._summary)
        layout.addWidget(self._which)
        layout.addWidget(self.view, 1)
        layout.addWidget(self._beyond)
        self.restyle(LIGHT)

    def show_preview(self, preview: Preview | None, rig: RigFile) -> None:
        """Show a plan; None where there is none that could be run."""
        self._preview, self._rig = preview, rig
        self._which.blockSignals(True)
        before = self._which.currentIndex()
        self._which.clear()
        for motion in preview.motions if preview else ():
            times = "once" if motion.n_trials == 1 else f"{motion.n_trials} times"
            mark = "⚠ " if motion.beyond else ""
            self._which.addItem(f"{mark}{motion.title} ({times})")
        self._which.setCurrentIndex(min(max(before, 0), self._which.count() - 1))
        self._which.blockSignals(False)
        say(self._summary, _summary(preview) if preview else _EMPTY, "" if preview else "faint")
        self._draw()

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self._theme = theme
        restyle_plot(self.view, theme)
        dashed, dotted = Qt.PenStyle.DashLine, Qt.PenStyle.DotLine
        self._path.setPen(pg.mkPen(theme.curves[0], width=2))
        for line in self._limits:
            line.setPen(pg.mkPen(theme.bad, width=2))
        self._safe.setPen(pg.mkPen(theme.good, width=1, style=dotted))
        self._deepest.setPen(pg.mkPen(theme.bad, width=1, style=dashed))
        self._skin.setPen(pg.mkPen(theme.curves[1], width=2, style=dashed))
        for line in (*self._limits, self._deepest, self._safe, self._skin):
            line.label.setColor(theme.text)
        self._draw()

    def _draw(self) -> None:
        for ground in self._grounds:
            self.view.removeItem(ground)
        self._grounds = []
        lever = self._rig.lever
        self._limits[0].setValue(lever.travel_min_mm)
        self._limits[1].setValue(lever.travel_max_mm)
        self._safe.setValue(lever.safe_position_mm)
        motion = self._motion()
        presses = motion is not None and any(leg.phase == "approach" for leg in motion.legs)
        for line in (self._skin, self._deepest):
            line.setVisible(presses)
        if motion is None or self._preview is None:
            self._path.setData([], [])
            say(self._beyond, "")
            return
        self._skin.setValue(self._preview.surface_mm)
        self._deepest.setValue(self._preview.surface_mm + lever.depth_max_mm)
        for leg in motion.legs:
            ground = pg.LinearRegionItem((leg.start_s, leg.stop_s), movable=False, pen=pg.mkPen(None))
            ground.setBrush(pg.mkBrush(self._theme.phase(leg.phase)))
            ground.setZValue(-10)
            self.view.addItem(ground)
            self._grounds.append(ground)
            if leg.stop_s - leg.start_s > _NAMED_SHARE * motion.legs[-1].stop_s:
                name = pg.TextItem(leg.phase, color=self._theme.faint, anchor=(0.5, 1.0))
                name.setPos(0.5 * (leg.start_s + leg.stop_s), lever.travel_max_mm)
                self.view.addItem(name)
                self._grounds.append(name)
        times, places = motion.path
        self._path.setData(times, places)
        margin_mm = 0.05 * (lever.travel_max_mm - lever.travel_min_mm)
        low = min([lever.travel_min_mm, *places.tolist()]) - margin_mm
        high = max([lever.travel_max_mm, *places.tolist()]) + margin_mm
        self.view.setRange(
            xRange=(0.0, float(times[-1]) if len(times) else 1.0), yRange=(low, high), padding=0.02
        )
        if motion.beyond:
            say(self._beyond, "⚠ " + "\n⚠ ".join(motion.beyond), "bad")
        else:
            say(self._beyond, "✓ within this rig's travel and speed, if the skin lies there", "good")

    def _motion(self) -> PlannedMotion | None:
        at = self._which.currentIndex()
        return self._preview.motions[at] if self._preview and 0 <= at < len(self._preview.motions) else None


def _summary(preview: Preview) -> str:
    trials = f"{preview.n_trials} trial{'s' if preview.n_trials != 1 else ''}"
    ends = datetime.now().astimezone() + timedelta(seconds=preview.expected_s)
    text = f"{trials}, {_length(preview.expected_s)}, begun now it ends at {ends:%H:%M}"
    if ends.date() != datetime.now().astimezone().date():
        text += f" on {ends:%A}"
    if preview.rest_s:
        text += f"; of that {_length(preview.rest_s)} of rest"
    if preview.hands:
        text += ". Hands: " + ", ".join(f"{what} ({n}×)" for what, n in preview.hands)
    return text + "."


def _length(seconds: float) -> str:
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"
