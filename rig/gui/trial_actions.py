"""What can be done with chosen trials: fit again, export, discard with a reason, and take that back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLineEdit, QMenu, QPushButton, QVBoxLayout, QWidget

from analysis.relaxation.result import Model, TrialFit
from rig.gui.asking import ask_folder
from rig.gui.controls import button, choice, say, words
from rig.gui.habits import Habits
from rig.gui.jobs.exporting import export_figure, export_fits, export_samples
from rig.gui.jobs.fitting import fit_rows
from rig.gui.jobs.headers import Header
from rig.gui.jobs.marking import discard, take_back
from rig.gui.jobs.traces import Axes
from rig.gui.numbers import counted
from rig.gui.trial_table import Row
from rig.gui.worker import Worker

_FITS_AT_A_TIME = 2
_KEY = "fits of the trials page"


class TrialActions(QWidget):
    """A row of buttons under the table.

    `fitted` gives fits by path, `marked` the new headers of files that were marked. ``rows`` are what is
    worked on, ``selected`` what was chosen on purpose: only such trials are discarded.
    """

    fitted = Signal(object)
    marked = Signal(object)
    said = Signal(str)

    def __init__(
        self,
        worker: Worker,
        habits: Habits,
        rows: Callable[[], list[Row]],
        selected: Callable[[], list[Row]],
    ) -> None:
        super().__init__()
        self._worker = worker
        self._habits = habits
        self._rows = rows
        self._selected = selected
        self._last_discarded: list[str] = []
        self._n_unreadable = 0
        self.overlaid: Callable[[], tuple[Axes, tuple[str, ...]]] = lambda: (Axes(), ())
        self._build()

    def fit_again(self) -> None:
        """Fit the trials by the model chosen, a few at a time."""
        rows = self._rows()
        paths = [row.path for row in rows if row.header is None or not row.header.problem]
        self._n_unreadable = len(rows) - len(paths)
        model: Model = "step" if self.model.currentText() == "step" else "ramp"
        self._worker.forget(_KEY)
        self._fit_next(paths, 0, 0, model)

    def stop(self) -> None:
        """Leave the trials that are not fitted yet."""
        self._worker.forget(_KEY)
        self._stop.hide()
        say(self._words, "stopped", "faint")

    def export(self, what: str) -> None:
        """Ask for a folder and write ``what``: fits, samples or figure."""
        start = self._habits.folder("export")
        ask_folder(self, "Where to write it", start, partial(self.export_to, what))

    def export_to(self, what: str, out: Path) -> None:
        """Write ``what`` into a folder."""
        self._habits.used_folder("export", out)
        rows = [row for row in self._rows() if row.header is None or not row.header.problem]
        paths = [row.path for row in rows]
        model: Model = "step" if self.model.currentText() == "step" else "ramp"
        if not paths:
            say(self._words, "No trial is chosen.", "note")
            return
        say(self._words, f"writing {what} of {counted(len(paths), 'trial')} to {out} ...", "faint")
        failed, done = self._failed, self._written
        if what == "fits":
            self._worker.ask("fits.csv", export_fits, paths, model, out, then=done, failed=failed, long=True)
        elif what == "samples":
            self._worker.ask("samples", export_samples, paths, out, then=done, failed=failed, long=True)
        else:
            axes, groups = self.overlaid()
            labels = groups if len(groups) == len(paths) else tuple(Path(path).stem for path in paths)
            name = "overlay"
            self._worker.ask(
                "the figure",
                export_figure,
                paths,
                labels,
                axes,
                out,
                name,
                then=done,
                failed=failed,
                long=True,
            )

    def ask_reason(self) -> None:
        """Open the line in which a reason for discarding is given."""
        if not self._selected():
            say(self._words, "Choose the trials to discard in the table first.", "note")
            return
        n = len(self._selected())
        say(self._question, f"Why {'is this trial' if n == 1 else f'are these {n} trials'} not to be used?")
        self._bar.show()
        self._reason.setFocus()

    def discard(self) -> None:
        """Discard the chosen trials for the reason given; the files stay."""
        reason = self._reason.text().strip()
        paths = [row.path for row in self._selected()]
        if not reason or not paths:
            say(self._question, "Discarding needs a reason: say why it is not used.", "bad")
            return
        self._bar.hide()
        self._last_discarded = paths
        self._worker.ask("discarding", discard, paths, reason, then=self._discarded, failed=self._failed)

    def undo(self) -> None:
        """Count again what was discarded last."""
        paths, self._last_discarded = self._last_discarded, []
        if paths:
            self._worker.ask("undoing", take_back, paths, then=self._taken_back, failed=self._failed)

    def keyPressEvent(self, event: QKeyEvent) -> None:  # noqa: N802
        """Esc closes the question, where nothing runs that it would stop."""
        if event.key() == Qt.Key.Key_Escape and self._bar.isVisible():
            self._bar.hide()
        else:
            super().keyPressEvent(event)

    def _build(self) -> None:
        self.model = choice("model of the fit", ("ramp", "step"), self._habits.choice("model", "ramp"),
                            partial(self._habits.keep_choice, "model"))  # fmt: skip
        self._stop = button("Stop", self.stop, tip="leave the trials that are not fitted yet")
        self._stop.hide()
        self._undo = button("&Undo", self.undo, tip="count again what was discarded last", key="Ctrl+Z")
        self._undo.hide()
        self._words = words("", "faint")
        row = QHBoxLayout()
        row.addWidget(
            button("Fit a&gain", self.fit_again, tip="fit the chosen trials, or all that are shown")
        )
        row.addWidget(self.model)
        row.addWidget(self._export_button())
        row.addWidget(
            button("&Discard …", self.ask_reason, tip="mark trials as no good; files stay", key="Del")
        )
        row.addStretch(1)
        row.addWidget(self._stop)
        row.addWidget(self._undo)
        self._question = words()
        self._reason = QLineEdit()
        self._reason.setPlaceholderText("as: the finger moved")
        self._reason.setAccessibleName("reason for discarding")
        self._reason.returnPressed.connect(self.discard)
        self._bar = QFrame()
        line = QVBoxLayout(self._bar)
        line.setContentsMargins(0, 0, 0, 0)
        answer = QHBoxLayout()
        answer.addWidget(self._reason, 1)
        answer.addWidget(button("Discard", self.discard, tip="mark them; the files stay (Enter)", main=True))
        answer.addWidget(button("Cancel", self._bar.hide, tip="leave them as they are"))
        line.addWidget(self._question)
        line.addLayout(answer)
        self._bar.hide()
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self._bar)
        layout.addLayout(row)
        layout.addWidget(self._words)

    def _export_button(self) -> QPushButton:
        made = QPushButton("&Export")
        made.setAccessibleName("Export")
        made.setToolTip("write the chosen trials, or all that are shown, for other programs")
        menu = QMenu(made)
        for text, what in (
            ("Fits as CSV (fits.csv) …", "fits"),
            ("Samples as CSV, a file a trial …", "samples"),
            ("Overlay as a figure (PNG, PDF) …", "figure"),
        ):
            menu.addAction(text, partial(self.export, what))
        made.setMenu(menu)
        return made

    def _fit_next(self, waiting: Sequence[str], n_fitted: int, n_failed: int, model: Model) -> None:
        done = n_fitted + n_failed
        if not waiting:
            self._stop.hide()
            others = f"; {n_failed} can't be, the column flags says why" if n_failed else ""
            if self._n_unreadable:
                others += f"; {self._n_unreadable} can't be read, the column state says why"
            fitted = f"{counted(n_fitted, 'trial')} fitted by the {model} model{others}"
            say(self._words, fitted if done or self._n_unreadable else "", "faint")
            return
        self._stop.show()
        say(self._words, f"fitting {done} of {done + len(waiting)}", "faint")
        now, later = list(waiting[:_FITS_AT_A_TIME]), waiting[_FITS_AT_A_TIME:]

        def got(rows: list[TrialFit]) -> None:
            self.fitted.emit(dict(zip(now, rows, strict=True)))
            good = sum(row.fitted for row in rows)
            self._fit_next(later, n_fitted + good, n_failed + len(rows) - good, model)

        def failed(problem: str) -> None:
            self.said.emit(problem)
            self._fit_next(later, n_fitted, n_failed + len(now), model)

        self._worker.ask("fits", fit_rows, now, model, then=got, failed=failed, key=_KEY)

    def _written(self, files: str | tuple[str, ...]) -> None:
        what = (
            files if isinstance(files, str) else f"{counted(len(files), 'file')} in {Path(files[0]).parent}"
        )
        say(self._words, f"written: {what}", "good")
        self.said.emit(f"written: {what}")

    def _discarded(self, headers: Sequence[Header]) -> None:
        self._undo.show()
        self._reason.clear()
        text = f"discarded: {', '.join(Path(header.path).stem for header in headers)}"
        say(self._words, text, "faint")
        self.said.emit(f"{text} ({headers[0].discarded})")
        self.marked.emit(headers)

    def _taken_back(self, headers: Sequence[Header]) -> None:
        self._undo.hide()
        text = f"counted again: {', '.join(Path(header.path).stem for header in headers)}"
        say(self._words, text, "faint")
        self.said.emit(text)
        self.marked.emit(headers)

    def _failed(self, problem: str) -> None:
        say(self._words, problem, "bad")
        self.said.emit(problem)
