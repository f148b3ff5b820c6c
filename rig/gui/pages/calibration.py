"""The calibration page: which one, what to prepare, the points as they come, the result beside the last."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QCheckBox,
    QHBoxLayout,
    QHeaderView,
    QStackedWidget,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from rig.engine.progress import CalibrationShown
from rig.engine.states import State
from rig.gui.bench_state import BenchState
from rig.gui.calibration_words import LARGE, difference_words, in_use_words, relative_change
from rig.gui.controls import button, say, words
from rig.gui.theme import LIGHT, Theme, restyle_plot

_PREPARE = {
    "position": (
        "Position: the stiff block on the Z stage",
        "You need the stiff block, the Z stage (or the micrometer) and nothing else below the arm.\n\n"
        "1.  The arm sweeps its travel in the air once.\n"
        "2.  The block is found slowly at stage height 0, then four times at each of six heights, "
        "160 um apart.\n"
        "3.  The line of position signal over stage height gives V/mm.\n\n"
        "About 6 minutes with a motorised stage.",
    ),
    "force": (
        "Force: weights on the inverted arm",
        "You need weights of 5 to 30 g and rubber bands, and the balance if there is one.\n\n"
        "1.  The free arm is recorded upright.\n"
        "2.  Turn the arm over when asked, then hang each weight when asked, twice in all.\n"
        "3.  The line of force signal over weight gives V/mN: W + m g / 2 = (V + V0) k.\n\n"
        "About 5 minutes. The weights stay below the force limit.",
    ),
}
_UNITS = {
    "volts_per_mm": "V/mm",
    "command_volts_per_mm": "V/mm",
    "position_zero_v": "V",
    "command_zero_v": "V",
    "volts_per_mn": "V/mN",
    "force_zero_v": "V",
}
_LEAST_FOR_A_LINE = 3


class CalibrationPage(QWidget):
    """A wizard of four steps, each a page; Abort stays where it is throughout.

    `start_asked` ("position" or "force", "person" or "bench" for the hands) and `accept_asked` are for the
    window.
    """

    start_asked = Signal(str, str)
    accept_asked = Signal(bool)

    def __init__(self) -> None:
        super().__init__()
        self._kind = "position"
        self._state = BenchState()
        self._theme = LIGHT
        self._in_use = words()
        self.by_bench = QCheckBox("simulated hands act by themselves")
        self._title, self._text = words("", "heading"), words()
        self._step = words("", "faint")
        self._running = words("", "heading")
        self._verdict = words()
        self._line_words = words("", "faint")
        self._plot, self._residuals = pg.PlotWidget(), pg.PlotWidget()
        self._table = _constants_table()
        self._start = button("Start", self._ask_start, tip="begin the calibration", main=True)
        self._back = button("Back", lambda: self._go(0), tip="choose the other calibration")
        self._keep = button(
            "Accept", lambda: self.accept_asked.emit(True), tip="later runs take it", main=True
        )
        self._leave = button("Reject", lambda: self.accept_asked.emit(False), tip="leave the last one in use")
        self._again = button("Close", lambda: self._go(0), tip="back to the choice")
        self._stack = QStackedWidget()
        self._stack.addWidget(self._choice_page())
        self._stack.addWidget(self._prepare_page())
        self._stack.addWidget(self._points_page())
        layout = QVBoxLayout(self)
        layout.setContentsMargins(12, 8, 12, 8)
        layout.addWidget(self._step)
        layout.addWidget(self._stack, 1)
        self._go(0)
        self.restyle(LIGHT)

    def choose(self, kind: str) -> None:
        """Go to the preparation of one of the two."""
        self._kind = kind
        title, text = _PREPARE[kind]
        say(self._title, title, "heading")
        self._text.setText(text)
        self._go(1)

    def show_state(self, state: BenchState) -> None:
        """Render the state: points and line while it runs, the result when there is one."""
        before, self._state = self._state, state
        self._start.setEnabled(state.ready)
        self.by_bench.setVisible(state.simulated)
        bench = state.snapshot.bench
        said = (
            "\n".join(in_use_words(item) for item in bench.calibrations) if bench else "no rig is connected"
        )
        self._in_use.setText(said)
        shown = state.snapshot.calibration
        if shown is None or state.link in {"closed", "opening"}:
            return
        if shown.decision == "" and state.running and before.snapshot.calibration is not shown:
            self._kind = shown.kind
            self._go(2)
        if (
            shown != before.snapshot.calibration
            or state.snapshot.trial_number != before.snapshot.trial_number
        ):
            self._draw(shown)
        if shown.decision and shown != before.snapshot.calibration:
            self._go(2)
        self._say_progress(state, shown)

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self._theme = theme
        for plot in (self._plot, self._residuals):
            restyle_plot(plot, theme)
        for item in (self._points, self._left):
            item.setSymbolBrush(theme.curves[0])
            item.setSymbolPen(theme.curves[0])
        self._line.setPen(pg.mkPen(theme.curves[1], width=2))
        self._zero.setPen(pg.mkPen(theme.line))

    def _ask_start(self) -> None:
        hands = "bench" if self.by_bench.isChecked() and self._state.simulated else "person"
        self.start_asked.emit(self._kind, hands)

    def _go(self, step: int) -> None:
        names = ("choose", "prepare", "measure", "decide")
        decided = self._state.snapshot.calibration
        at = 3 if step == 2 and decided is not None and decided.decision else step
        path = "   ›   ".join(f"[{name}]" if i == at else name for i, name in enumerate(names))
        say(self._step, path, "faint")
        self._stack.setCurrentIndex(step)

    def _say_progress(self, state: BenchState, shown: CalibrationShown) -> None:
        s = state.snapshot
        waiting = shown.decision == "waiting"
        for made in (self._keep, self._leave):
            made.setVisible(waiting)
            made.setEnabled("accept" not in state.asked)
        self._again.setVisible(
            shown.decision in {"kept", "left"} or (not state.running and not shown.decision)
        )
        self._table.setVisible(bool(shown.constants))
        self._verdict.setVisible(bool(shown.constants))
        name = shown.kind.capitalize()
        if shown.decision == "kept":
            say(self._running, f"{name} calibration accepted", "heading")
        elif shown.decision == "left":
            say(self._running, f"{name} calibration rejected: the last one stays in use", "heading")
        elif waiting:
            say(self._running, f"{name} calibration: accept it?", "heading")
        elif state.running and s.state is not State.IDLE:
            say(self._running, f"{name} calibration: {s.trial_number} of {s.n_trials}, {s.state}", "heading")
        elif s.state is State.FINISHED:
            say(self._running, f"{name} calibration: working it out", "heading")
        else:
            say(self._running, f"{name} calibration ended early; nothing was changed", "heading")
        if shown.constants:
            self._fill(shown)

    def _draw(self, shown: CalibrationShown) -> None:
        self._plot.setLabel("bottom", shown.x_name)
        self._residuals.setLabel("bottom", shown.x_name)
        x = np.array([point[0] for point in shown.points])
        y = np.array([point[1] for point in shown.points])
        self._points.setData(x, y)
        if len(set(x.tolist())) < _LEAST_FOR_A_LINE:
            self._line.setData([], [])
            self._left.setData([], [])
            self._line_words.setText(f"{len(x)} points; a line from three on")
            return
        slope, intercept = np.polyfit(x, y, 1)
        ends = np.array([x.min(), x.max()])
        residuals_mv = 1e3 * (y - intercept - slope * x)
        self._line.setData(ends, intercept + slope * ends)
        self._left.setData(x, residuals_mv)
        unit = "V/mm" if shown.kind == "position" else "V/mN"
        r2 = 1 - np.sum(residuals_mv**2) / np.sum((1e3 * (y - y.mean())) ** 2)
        self._line_words.setText(
            f"{len(x)} points   slope {slope:.6g} {unit}   residual {np.std(residuals_mv):.2f} mV rms   R² {r2:.8f}"
        )

    def _fill(self, shown: CalibrationShown) -> None:
        self._table.setRowCount(len(shown.constants))
        apart = []
        for i, constant in enumerate(shown.constants):
            texts = (
                constant.name,
                f"{constant.value:.6g} ± {constant.half_width_95:.2g} {_UNITS.get(constant.name, '')}",
                f"{constant.in_use:.6g}",
                difference_words(constant),
            )
            for j, text in enumerate(texts):
                self._table.setItem(i, j, QTableWidgetItem(text))
            share = relative_change(constant)
            if share is not None and abs(share) > LARGE:
                apart.append(constant.name)
        self._table.setFixedHeight(30 + 26 * len(shown.constants))
        if apart:
            text = (
                f"⚠ {', '.join(apart)} differ by more than {100 * LARGE:g} % from what is in use: look twice"
            )
            say(self._verdict, text, "bad")
        else:
            say(self._verdict, f"✓ within {100 * LARGE:g} % of what is in use", "good")

    def _choice_page(self) -> QWidget:
        page = QWidget()
        layout = QVBoxLayout(page)
        layout.addWidget(words("Calibration", "heading"))
        layout.addWidget(words("In use by the rig that is connected:"))
        layout.addWidget(self._in_use)
        row = QHBoxLayout()
        for kind in ("position", "force"):
            tip = f"measure the constants of {kind}"
            row.addWidget(button(f"Calibrate {kind} ...", partial(self.choose, kind), tip=tip))
        row.addStretch(1)
        layout.addLayout(row)
        layout.addStretch(1)
        return page

    def _prepare_page(self) -> QWidget:
        page = QWidget()
        layout = QVBoxLayout(page)
        layout.addWidget(self._title)
        layout.addWidget(self._text)
        layout.addWidget(self.by_bench)
        row = QHBoxLayout()
        row.addWidget(self._back)
        row.addWidget(self._start)
        row.addStretch(1)
        layout.addLayout(row)
        layout.addStretch(1)
        return page

    def _points_page(self) -> QWidget:
        page = QWidget()
        layout = QVBoxLayout(page)
        layout.setSpacing(4)
        layout.addWidget(self._running)
        for plot, name in ((self._plot, "signal (V)"), (self._residuals, "residual (mV)")):
            plot.setMenuEnabled(False)
            plot.hideButtons()
            plot.setMouseEnabled(x=False, y=False)
            plot.setLabel("left", name)
            plot.setAccessibleName(name)
            plot.getAxis("left").setWidth(58)
        self._points = self._plot.plot(pen=None, symbol="o", symbolSize=7)
        self._line = self._plot.plot()
        self._left = self._residuals.plot(pen=None, symbol="o", symbolSize=7)
        self._zero = pg.InfiniteLine(0.0, angle=0)
        self._residuals.addItem(self._zero)
        layout.addWidget(self._plot, 3)
        layout.addWidget(self._residuals, 2)
        layout.addWidget(self._line_words)
        layout.addWidget(self._table)
        layout.addWidget(self._verdict)
        row = QHBoxLayout()
        for made in (self._keep, self._leave, self._again):
            row.addWidget(made)
        row.addStretch(1)
        layout.addLayout(row)
        return page


def _constants_table() -> QTableWidget:
    table = QTableWidget(0, 4)
    table.setHorizontalHeaderLabels(["constant", "measured, 95 % interval", "in use", "change"])
    table.setAccessibleName("constants found")
    table.verticalHeader().hide()
    table.verticalHeader().setDefaultSectionSize(26)
    table.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
    table.setFocusPolicy(Qt.FocusPolicy.TabFocus)
    header: Any = table.horizontalHeader()
    header.setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
    return table
