"""What came out of a trial, right after it: the fit over the recording, what it leaves, and its numbers."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import pyqtgraph as pg
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QFontMetrics
from PySide6.QtWidgets import (
    QAbstractItemView,
    QHeaderView,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from analysis.relaxation.result import TrialFit
from analysis.relaxation.study import Summary, depth_level, summarise, value_of
from rig.gui.controls import say, words
from rig.gui.habits import Habits
from rig.gui.jobs.fitting import FitPicture, fit_rows, picture_fit
from rig.gui.numbers import with_error
from rig.gui.theme import LIGHT, Theme, legend_below, restyle_plot
from rig.gui.worker import Worker

_BINS = 500
_AT_A_TIME = 4
_EMPTY = "After each trial its fit appears here: recorded force, fitted force, and what is left."
_ROWS = (
    ("A0_mn", "A0", "mN", "elastic force: what a long hold would come down to"),
    ("A1_over_A0", "A1/A0", "", "share of the slow relaxation"),
    ("t1_s", "t1", "s", "time of the slow relaxation"),
    ("A2_over_A0", "A2/A0", "", "share of the quick relaxation"),
    ("t2_s", "t2", "s", "time of the quick relaxation"),
    ("stiffness_mn_per_um", "stiffness", "mN/um", "A0 by depth"),
)
_COLUMNS = ("", "this trial", "study so far", "n")
_LONGEST = "0.00000 ± 0.00000"


class FitPanel(QWidget):
    """Fits a trial in the worker and shows it.

    The study's running mean is that of the same finger and depth in the trial's folder; trials recorded
    before the window was opened are fitted in the background. `fitted` gives each trial's row.
    """

    fitted = Signal(Path, object)
    said = Signal(str)

    def __init__(self, worker: Worker, habits: Habits, name: str = "fit panel") -> None:
        super().__init__()
        self._worker = worker
        self._habits = habits
        self._name = name
        self._rows: dict[str, TrialFit] = {}
        self._picture: FitPicture | None = None
        self._asked = ""
        self._theme = LIGHT
        self._title = words(_EMPTY, "faint")
        self._flags = words()
        self._force, self._residual = pg.PlotWidget(), pg.PlotWidget()
        self._make_plots()
        self._table = self._make_table()
        layout = QVBoxLayout(self)
        layout.setContentsMargins(4, 4, 4, 4)
        layout.setSpacing(4)
        layout.addWidget(self._title)
        layout.addWidget(self._force, 3)
        layout.addWidget(self._residual, 2)
        layout.addWidget(self._table)
        layout.addWidget(self._flags)
        self.restyle(LIGHT)

    def show_trial(self, path: Path) -> None:
        """Fit a trial and show it; the one shown before stays until the fit is there."""
        self._asked = str(path)
        self._worker.ask(
            f"the fit of {path.name}",
            picture_fit,
            str(path),
            "ramp",
            _BINS,
            then=self._show,
            failed=self._failed,
            key=self._name,
            urgent=True,
        )

    def show_study(self, paths: list[Path]) -> None:
        """Take the trials recorded so far into the running mean, in the background."""
        waiting = [str(path) for path in paths if str(path) not in self._rows]
        for i in range(0, len(waiting), _AT_A_TIME):
            chunk = waiting[i : i + _AT_A_TIME]
            self._worker.ask(
                "fits of earlier trials",
                fit_rows,
                chunk,
                "ramp",
                then=partial(self._take, chunk),
            )

    def know(self, fits: Mapping[str, TrialFit]) -> None:
        """Take fits made elsewhere, by the ramp model, into the running mean."""
        for path, row in fits.items():
            if row.fitted and not row.discarded and row.model == "ramp":
                self._rows[path] = row
        self._fill()

    def forget_trial(self, path: Path) -> None:
        """Leave a trial out of the running mean, as one that was discarded."""
        if self._rows.pop(str(path), None) is not None:
            self._fill()

    def clear(self) -> None:
        """Show nothing."""
        self._worker.forget(self._name)
        self._picture, self._asked = None, ""
        say(self._title, _EMPTY, "faint")
        say(self._flags, "")
        self._draw()
        self._fill()

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self._theme = theme
        for plot in (self._force, self._residual):
            restyle_plot(plot, theme)
        self._recorded.setPen(pg.mkPen(theme.faint, width=1))
        self._fitted.setPen(pg.mkPen(theme.curves[1], width=2))
        self._left.setPen(pg.mkPen(theme.line, width=1))
        self._means.setPen(pg.mkPen(theme.curves[0], width=2))
        self._zero.setPen(pg.mkPen(theme.text, width=1))

    def _make_plots(self) -> None:
        for plot, name in (
            (self._force, "recorded and fitted force"),
            (self._residual, "residual of the fit"),
        ):
            plot.setMenuEnabled(False)
            plot.setAccessibleName(name)
            plot.hideButtons()
            plot.getAxis("left").setWidth(52)
        self._force.setLabel("left", "force (mN)")
        legend_below(self._force)
        self._residual.setLabel("left", "left (mN)")
        self._residual.setLabel("bottom", "time from the end of the ramp (s)")
        self._residual.setXLink(self._force)
        self._recorded = self._force.plot(name="recorded")
        self._fitted = self._force.plot(name="fit")
        self._left = self._residual.plot()
        self._means = self._residual.plot()
        self._zero = pg.InfiniteLine(0.0, angle=0)
        self._residual.addItem(self._zero)

    def _make_table(self) -> QTableWidget:
        table = QTableWidget(len(_ROWS), len(_COLUMNS))
        table.setAccessibleName("parameters of the fit")
        table.setHorizontalHeaderLabels(list(_COLUMNS))
        table.verticalHeader().hide()
        table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        table.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        table.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        header = table.horizontalHeader()
        header.setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
        header.setSectionResizeMode(0, QHeaderView.ResizeMode.Interactive)
        header.setSectionResizeMode(3, QHeaderView.ResizeMode.Interactive)
        measure = QFontMetrics(table.font())
        sides = [measure.horizontalAdvance(text) for text in ("stiffness, mN/um  ", "0000  ")]
        header.resizeSection(0, sides[0])
        header.resizeSection(3, sides[1])
        # a number with its error is read whole, or not at all
        table.setMinimumWidth(
            sum(sides) + 2 * measure.horizontalAdvance(f"{_LONGEST}  ") + 2 * table.frameWidth()
        )
        height = measure.height() + 6
        table.verticalHeader().setDefaultSectionSize(height)
        table.verticalHeader().setMinimumSectionSize(height)
        table.setFixedHeight(height * len(_ROWS) + header.sizeHint().height() + 14)
        for i, (_, title, unit, tip) in enumerate(_ROWS):
            item = QTableWidgetItem(f"{title}, {unit}" if unit else title)
            item.setToolTip(tip)
            table.setItem(i, 0, item)
        return table

    def _show(self, picture: FitPicture) -> None:
        row = picture.row
        self._picture = picture
        if row.fitted and not row.discarded:
            self._rows[picture.path] = row
        say(self._title, f"{Path(picture.path).stem}{_goodness(row)}")
        say(self._flags, *_flag_words(picture))
        self._draw()
        self._fill()
        self.fitted.emit(Path(picture.path), row)

    def _failed(self, problem: str) -> None:
        self._picture = None
        say(self._title, Path(self._asked).stem)
        say(self._flags, problem, "bad")
        self._draw()
        self._fill()
        self.said.emit(problem)

    def _take(self, paths: list[str], rows: list[TrialFit]) -> None:
        self.know(dict(zip(paths, rows, strict=True)))
        for path, row in zip(paths, rows, strict=True):
            self.fitted.emit(Path(path), row)

    def _draw(self) -> None:
        picture = self._picture
        curves = (self._recorded, self._fitted, self._left, self._means)
        if picture is None:
            for curve in curves:
                curve.setData([], [])
            return
        parts = (picture.recorded, picture.fitted, picture.residual, picture.means)
        for curve, part in zip(curves, parts, strict=True):
            curve.setData(part[0], part[1])
        for plot in (self._force, self._residual):
            plot.autoRange()

    def _fill(self) -> None:
        picture = self._picture
        row = picture.row if picture is not None else None
        group = self._group(picture)
        for i, (name, *_) in enumerate(_ROWS):
            value = value_of(row, name) if row is not None else None
            estimate = row.estimates.get(name) if row is not None else None
            summary = group.get(name)
            own = "" if value is None else with_error(value, estimate.se if estimate else None)
            mean = "" if summary is None else with_error(summary.mean, summary.sd)
            for column, text in enumerate((own, mean, str(summary.n) if summary else ""), start=1):
                item = QTableWidgetItem(text)
                item.setTextAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
                item.setToolTip(_tip(column, group_words=self._group_words(picture)))
                self._table.setItem(i, column, item)

    def _group(self, picture: FitPicture | None) -> dict[str, Summary]:
        """Return the summary of the trials in the same folder with the same finger and depth."""
        if picture is None or not picture.row.fitted:
            return {}
        folder = Path(picture.path).parent
        rows = [row for path, row in self._rows.items() if Path(path).parent == folder]
        depth_mm = depth_level(picture.row.depth_mm)
        for group in summarise(rows).groups:
            if (group.finger, group.depth_mm) == (picture.row.finger, depth_mm):
                return group.columns
        return {}

    def _group_words(self, picture: FitPicture | None) -> str:
        if picture is None or picture.row.depth_mm is None:
            return ""
        return f"{picture.row.finger or 'finger not named'} at {picture.row.depth_mm:.2f} mm"


def _goodness(row: TrialFit) -> str:
    if not row.fitted or row.rms_mn is None or row.r2 is None:
        return ""
    return f"   rms left {row.rms_mn:.2f} mN, R² {row.r2:.4f}"


def _flag_words(picture: FitPicture) -> tuple[str, str]:
    """Return what the checks say, and the role it is shown in."""
    row = picture.row
    if not row.fitted:
        known = row.failure.startswith("no relaxation of skin")
        return (f"No fit: {row.failure}", "note" if known else "bad")
    raised = [f"⚠ {check.text} ({check.flag})" for check in row.checks if check.raised]
    if row.discarded:
        raised.insert(0, f"discarded: {row.discarded}")
    return ("\n".join(raised), "bad") if raised else ("✓ no check raised", "good")


def _tip(column: int, group_words: str) -> str:
    return {
        1: "estimate ± standard error",
        2: f"mean ± standard deviation over trials: {group_words}",
        3: f"trials in the mean: {group_words}",
    }[column]
