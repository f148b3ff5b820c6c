"""The mismatch page: recordings beside the simulation, what the simulation leaves out, and what to do next."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt, QTimer, QUrl, Signal
from PySide6.QtGui import QDesktopServices, QHideEvent, QPixmap
from PySide6.QtWidgets import (
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QScrollArea,
    QSplitter,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from rig.gui.asking import ask_folder
from rig.gui.comparison_plot import ComparisonPlot
from rig.gui.controls import button, choice, say, words
from rig.gui.findings_view import FindingsView
from rig.gui.habits import Habits
from rig.gui.jobs.comparing import Comparison, compare_trial, run_diagnosis, trials_to_compare
from rig.gui.jobs.report_file import DiagnosisFolder, read_diagnosis
from rig.gui.numbers import counted
from rig.gui.theme import Theme
from rig.gui.worker import Worker

_KEY = "diagnosis"
_FOLDER_NAME = "diagnosis"


class MismatchPage(QWidget):
    """Diagnoses a folder of trials and shows what came out.

    `run_asked` gives the protocol of the next experiment, `twin_asked` the rig file of the twin.
    """

    said = Signal(str)
    run_asked = Signal(Path)
    twin_asked = Signal(Path)

    def __init__(self, worker: Worker, habits: Habits) -> None:
        super().__init__()
        self._worker = worker
        self._habits = habits
        self.trials: Path | None = habits.folder("trials")
        self.found: DiagnosisFolder | None = None
        self._begun_s = 0.0
        self.findings = FindingsView()
        self.comparison = ComparisonPlot()
        self._clock = QTimer(self)
        self._clock.setInterval(1000)
        self._clock.timeout.connect(self._tick)
        self._build()
        self.comparison.trial_asked.connect(self._compare)
        self.findings.window_asked.connect(self._look_at)

    def use_trials(self, folder: Path) -> None:
        """Take the folder that is to be diagnosed."""
        self.trials = folder.absolute()
        self._path.setText(str(self.trials))
        self._run_button.setEnabled(not self._clock.isActive())

    def diagnose(self) -> None:
        """Run the diagnosis of the folder; what is open stays until it is there."""
        if self.trials is None:
            say(self._state, "Choose a folder of trials first.", "note")
            return
        out = self.trials / _FOLDER_NAME
        baseline = self._baseline.currentText().split()[0]
        self._begun_s = time.monotonic()
        self._clock.start()
        self._set_running(True)
        self._tick()
        self.said.emit(f"diagnosis of {self.trials}: begun")
        self._worker.ask(
            f"the diagnosis of {self.trials}",
            run_diagnosis,
            [self.trials],
            out,
            baseline,
            then=partial(self._diagnosed, self.trials),
            failed=self._failed,
            key=_KEY,
            long=True,
        )

    def stop(self) -> None:
        """Give the diagnosis up."""
        self._worker.stop(_KEY)
        self._set_running(False)
        say(self._state, "The diagnosis was stopped; nothing was written.", "note")
        self.said.emit("the diagnosis was stopped")

    def open_diagnosis(self, folder: Path, trials: Path | None = None) -> None:
        """Show a diagnosis made before; ``trials`` are by default those beside its folder."""
        beside = trials or folder.absolute().parent
        self._worker.ask(
            f"the report in {folder}",
            read_diagnosis,
            folder.absolute(),
            then=partial(self._show, beside),
            failed=self._failed,
            key="report",
            urgent=True,
        )

    def show_figures(self) -> None:
        """Show the figures of the report in place of the one trial."""
        self._tabs.setCurrentWidget(self._figures)

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self.comparison.restyle(theme)

    def hideEvent(self, event: QHideEvent) -> None:  # noqa: N802
        """Remember the layout."""
        super().hideEvent(event)
        self._habits.keep_layout("mismatch.split", bytes(self._split.saveState().data()))

    def _build(self) -> None:
        self._path = QLineEdit(str(self.trials or ""))
        self._path.setReadOnly(True)
        self._path.setPlaceholderText("no folder of trials is chosen")
        self._path.setAccessibleName("trials to be diagnosed")
        self._baseline = choice(
            "what the simulation begins with",
            ("ramp (the recorded motion)", "step (the textbook's)"),
            self._habits.choice("baseline", ""),
            partial(self._habits.keep_choice, "baseline"),
        )
        self._run_button = button(
            "&Diagnose", self.diagnose, tip="compare the trials with the simulation", main=True
        )
        self._run_button.setEnabled(self.trials is not None)
        self._stop_button = button("S&top", self.stop, tip="give the diagnosis up")
        self._stop_button.hide()
        self._page_button = button("Full &report", self._open_page, tip="open report.html in the browser")
        self._page_button.setEnabled(False)
        self._state = words("", "faint")
        bar = QHBoxLayout()
        bar.addWidget(
            button("&Trials …", self._ask_trials, tip="choose the folder to diagnose", key="Ctrl+O")
        )
        bar.addWidget(self._path, 1)
        bar.addWidget(self._baseline)
        bar.addWidget(self._run_button)
        bar.addWidget(self._stop_button)
        bar.addWidget(button("Open diagnosis …", self._ask_diagnosis, tip="show one that was made before"))
        bar.addWidget(self._page_button)
        self._figures = QScrollArea()
        self._figures.setWidgetResizable(True)
        self._figures.setAccessibleName("figures of the report")
        self._tabs = QTabWidget()
        self._tabs.addTab(self.comparison, "One tria&l")
        self._tabs.addTab(self._figures, "&Figures of the report")
        self._split = QSplitter(Qt.Orientation.Horizontal)
        self._split.addWidget(self.findings)
        self._split.addWidget(self._tabs)
        self._split.setChildrenCollapsible(False)
        self._split.setSizes([470, 790])
        state = self._habits.layout("mismatch.split")
        if state is not None:
            self._split.restoreState(state)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(6, 6, 6, 6)
        layout.addLayout(bar)
        layout.addWidget(self._state)
        layout.addWidget(self._split, 1)

    def _ask_trials(self) -> None:
        ask_folder(self, "Trials to diagnose", self.trials or self._habits.folder("trials"), self.use_trials)

    def _ask_diagnosis(self) -> None:
        start = self._habits.folder("diagnoses") or self.trials
        ask_folder(self, "Folder of a diagnosis", start, self.open_diagnosis)

    def _open_page(self) -> None:
        if self.found is not None and self.found.page is not None:
            QDesktopServices.openUrl(QUrl.fromLocalFile(str(self.found.page)))

    def _set_running(self, running: bool) -> None:
        if not running:
            self._clock.stop()
        self._stop_button.setVisible(running)
        self._run_button.setEnabled(not running and self.trials is not None)

    def _tick(self) -> None:
        passed = int(time.monotonic() - self._begun_s)
        say(
            self._state,
            f"Comparing the trials with the simulation and every mechanism of the library, "
            f"{passed // 60}:{passed % 60:02d} so far.",
            "note",
        )

    def _diagnosed(self, trials: Path, out: Path) -> None:
        self._set_running(False)
        self.said.emit(f"diagnosis of {trials}: written to {out}")
        self.open_diagnosis(out, trials)

    def _failed(self, problem: str) -> None:
        self._set_running(False)
        say(self._state, problem, "bad")
        self.said.emit(problem)

    def _show(self, trials: Path, found: DiagnosisFolder) -> None:
        self.found = found
        if self.trials is None:
            self.use_trials(trials)
        self._habits.used_folder("diagnoses", found.folder)
        say(
            self._state,
            f"{found.folder}: {counted(found.report.n_trials, 'trial')}, baseline {found.report.baseline}",
            "faint",
        )
        self._page_button.setEnabled(found.page is not None)
        self.findings.show_diagnosis(found, self._run_next, self._use_twin)
        self._take_figures(found)
        self.comparison.wait_for("reading the trials ...")
        self._worker.ask(
            "the list of trials",
            trials_to_compare,
            [trials],
            then=lambda offer: self.comparison.offer(offer, found.report.mismatch),
            failed=self.comparison.show_problem,
            key="trials to compare",
        )

    def _take_figures(self, found: DiagnosisFolder) -> None:
        inside = QWidget()
        column = QVBoxLayout(inside)
        for path in found.figures:
            picture = QLabel()
            image = QPixmap(str(path))
            width = min(max(400, self._tabs.width() - 60), image.width())
            picture.setPixmap(image.scaledToWidth(width, Qt.TransformationMode.SmoothTransformation))
            picture.setAccessibleName(f"figure: {path.stem}")
            column.addWidget(words(path.stem, "faint"))
            column.addWidget(picture)
        column.addStretch(1)
        self._figures.setWidget(inside)

    def _compare(self, path: str) -> None:
        if self.found is None:
            return

        def got(comparison: Comparison) -> None:
            self.comparison.show_comparison(comparison)

        self._worker.ask(
            f"the simulation of {Path(path).name}",
            compare_trial,
            path,
            self.found.report,
            then=got,
            failed=self.comparison.show_problem,
            key="comparison",
            urgent=True,
        )

    def _look_at(self, window: object) -> None:
        self._tabs.setCurrentWidget(self.comparison)
        self.comparison.look_at(window)  # type: ignore[arg-type]

    def _run_next(self) -> None:
        if self.found is not None and self.found.next_protocol is not None:
            self.run_asked.emit(self.found.next_protocol)

    def _use_twin(self) -> None:
        if self.found is not None and self.found.twin is not None:
            self.twin_asked.emit(self.found.twin)
