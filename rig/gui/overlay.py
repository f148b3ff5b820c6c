"""The trials that are chosen, over each other: what is shown over what, and finer where one looks closer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from PySide6.QtCore import QTimer, Signal
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QVBoxLayout, QWidget

from rig.gui.controls import button, choice, say, words
from rig.gui.habits import Habits
from rig.gui.jobs.traces import ORIGINS, SCALES, SHOWN, Axes, Origin, Scale, Shown, Trace, read_traces
from rig.gui.numbers import counted
from rig.gui.theme import Theme
from rig.gui.trial_plot import TrialPlot
from rig.gui.worker import Worker

MOST_TRIALS = 300
_BINS = 600
_AT_A_TIME = 20
_SETTLE_MS = 60
_KEY = "overlay"
_GROUPED_BY = ("by depth", "by finger", "by file")
_EMPTY = "Choose trials in the table (Ctrl+A: all that are shown) to see them here over each other."


@dataclass(frozen=True, slots=True)
class Chosen:
    """A trial to be drawn: its file and what it can be coloured by."""

    path: str
    finger: str
    depth_mm: float | None
    name: str

    def group(self, by: str) -> str:
        """Return the group it belongs to."""
        if by == "by finger":
            return self.finger or "finger not named"
        if by == "by file":
            return self.name
        return "depth not stated" if self.depth_mm is None else f"{self.depth_mm:.2f} mm"


class Overlay(QWidget):
    """Draws chosen trials; they are read and thinned in the worker, some at a time."""

    picked = Signal(str)
    said = Signal(str)

    def __init__(self, worker: Worker, habits: Habits) -> None:
        super().__init__()
        self._worker = worker
        self._habits = habits
        self._chosen: dict[str, Chosen] = {}
        self._problems: list[str] = []
        self._left_out = 0
        self.plot = TrialPlot()
        self.plot.picked.connect(self.picked)
        self.plot.span_asked.connect(self._look_closer)
        self._words = words(_EMPTY, "faint")
        self._settle = QTimer(self)
        self._settle.setSingleShot(True)
        self._settle.setInterval(_SETTLE_MS)
        self._settle.timeout.connect(self._draw)
        bar = QHBoxLayout()
        self._shown = self._choice("what is shown", SHOWN)
        self._origin = self._choice("where time begins", ORIGINS)
        self._scale = self._choice("scale of the force", SCALES)
        self._by = self._choice("colours", _GROUPED_BY)
        for box in (self._shown, self._origin, self._scale, self._by):
            bar.addWidget(box)
        bar.addWidget(button("Show &all", self.plot.show_all, tip="zoom out to all that is drawn"))
        bar.addStretch(1)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(4, 4, 4, 4)
        layout.addLayout(bar)
        layout.addWidget(self.plot, 1)
        layout.addWidget(self._words)
        self.plot.clear(self.axes)

    @property
    def axes(self) -> Axes:
        """What is shown over what."""
        shown: Shown = self._shown.currentText()  # type: ignore[assignment]
        origin: Origin = self._origin.currentText()  # type: ignore[assignment]
        scale: Scale = self._scale.currentText()  # type: ignore[assignment]
        return Axes(shown, origin, scale)

    @property
    def groups(self) -> tuple[str, ...]:
        """The colour group of every trial that is chosen."""
        return tuple(one.group(self._by.currentText()) for one in self._chosen.values())

    def show_chosen(self, chosen: Sequence[Chosen]) -> None:
        """Draw these trials, as soon as the choice has settled."""
        self._chosen = {one.path: one for one in chosen[:MOST_TRIALS]}
        self._left_out = max(0, len(chosen) - MOST_TRIALS)
        self._worker.forget(_KEY)  # what is being read belongs to the choice before
        self._settle.start()

    def highlight(self, path: str) -> None:
        """Draw one trial on top."""
        self.plot.choose(path)

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self.plot.restyle(theme)

    def _choice(self, name: str, items: Sequence[str]) -> QComboBox:
        def changed(value: str) -> None:
            self._habits.keep_choice(name, value)
            self._settle.start()

        return choice(name, items, self._habits.choice(name, items[0]), changed)

    def _draw(self) -> None:
        over_time = self.axes.over_time
        self._origin.setEnabled(over_time)
        self._scale.setEnabled(self.axes.shown != "position over time")
        self._worker.forget(_KEY)
        self._problems = []
        self.plot.clear(self.axes, sorted(set(self.groups)))
        self._read(list(self._chosen), None)
        self._tell()

    def _look_closer(self, *_: float) -> None:
        self._worker.forget(_KEY)
        self._read(list(self._chosen), self.plot.span)

    def _read(self, paths: list[str], span: tuple[float, float] | None) -> None:
        if not paths:
            return
        now, later = paths[:_AT_A_TIME], paths[_AT_A_TIME:]
        self._worker.ask(
            "reading trials",
            read_traces,
            now,
            self.axes,
            _BINS,
            span,
            then=partial(self._got, later, span),
            failed=self._failed,
            key=_KEY,
            urgent=True,
        )

    def _got(self, later: list[str], span: tuple[float, float] | None, traces: Sequence[Trace]) -> None:
        if span is None:
            self._problems += [trace.problem for trace in traces if trace.problem]
        by = self._by.currentText()
        groups = [self._chosen[trace.path].group(by) for trace in traces]
        self.plot.show_traces(traces, groups, fit_view=span is None)
        self._tell()
        self._read(later, span)

    def _failed(self, problem: str) -> None:
        self._problems.append(problem)
        self._tell()
        self.said.emit(problem)

    def _tell(self) -> None:
        if not self._chosen:
            say(self._words, _EMPTY, "faint")
            return
        text = f"{len(self.plot.shown)} of {counted(len(self._chosen), 'trial')} drawn"
        if self._left_out:
            text += f"; {self._left_out} more are chosen, too many for one plot"
        if self._problems:
            more = f" (and {len(self._problems) - 1} more)" if len(self._problems) > 1 else ""
            say(self._words, f"{text}; {self._problems[0]}{more}", "bad")
        else:
            say(self._words, text, "faint")
