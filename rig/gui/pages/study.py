"""The study page: what is to be recorded, what has been, how good it is, and what may be done about it."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QAbstractItemView,
    QCheckBox,
    QHBoxLayout,
    QHeaderView,
    QSplitter,
    QTableView,
    QVBoxLayout,
    QWidget,
)

from analysis.errors import BadInputError
from rig.engine.loading import load_run
from rig.gui.asking import ask_file, ask_folder
from rig.gui.bench_state import BenchState
from rig.gui.controls import button, say, words
from rig.gui.discard_bar import DiscardBar
from rig.gui.fit_panel import FitPanel
from rig.gui.habits import Habits
from rig.gui.jobs.headers import Header, list_folder, read_headers
from rig.gui.numbers import counted
from rig.gui.study_table import QUALITY, StudyRow, StudyTable
from rig.gui.theme import Theme
from rig.gui.worker import Worker
from rig.protocols.steps import Plan
from rig.settings.rig_file import RigFile

_WIDTHS = (34, 62, 48, 40, 94, 60, 46, 46)
_FOLDER = "study folder"
"""Key of the job that reads what the study's folder holds."""


class StudyPage(QWidget):
    """Shows one protocol and its folder.

    `discard_asked` (file, reason), `repeat_asked` (planned trial's name) and `restore_asked` (file) are for
    the window, which knows whether a run is in progress. `failed` says why a protocol can't be shown.
    """

    said = Signal(str)
    failed = Signal(str)
    discard_asked = Signal(Path, str)
    restore_asked = Signal(Path)
    repeat_asked = Signal(str)

    def __init__(self, worker: Worker, habits: Habits) -> None:
        super().__init__()
        self._worker = worker
        self._habits = habits
        self._rig = RigFile()
        self._shown_trial = ""
        self._seen: set[Path] = set()
        self._ran = False
        self.protocol: Path | None = None
        self.out: Path | None = None
        self.plan: Plan | None = None
        self.table = StudyTable()
        self.fit_panel = FitPanel(worker, habits, "fit of the study page")
        self.by_bench = QCheckBox("simulated hands act by themselves")
        self.by_bench.setToolTip(
            "off: you are asked, as at the real bench, and the simulated hands follow you"
        )
        self._title = words("No protocol yet", "heading")
        self._folder = words("", "faint")
        self._view = self._make_view()
        self._bar = DiscardBar()
        self._bar.confirmed.connect(self.discard_asked)
        self._bar.said.connect(self.said)
        self._build()
        self.fit_panel.fitted.connect(self.table.take_fit)
        self.fit_panel.said.connect(self.said)

    def set_rig(self, rig: RigFile) -> None:
        """Check protocols against this rig from now on."""
        self._rig = rig

    def load(self, protocol: Path, out: Path | None = None) -> bool:
        """Show a protocol, its trials in ``out`` (by default a folder of its name); say where it can't be."""
        if out is None:
            home = self._habits.folder("studies") or Path.home() / "indenter-trials"
            out = home / protocol.stem
        try:
            loaded = load_run(protocol, self._rig, out)
        except (BadInputError, OSError) as error:
            self.failed.emit(" ".join(str(error).split()))
            return False
        self.protocol, self.out, self.plan = protocol.absolute(), out.absolute(), loaded.plan
        self._habits.used_protocol(self.protocol)
        self._shown_trial = ""
        self._seen.clear()
        self._worker.forget(_FOLDER)  # plans name their trials alike: another folder's are not this one's
        self.table.load(loaded.plan.trials)
        self.fit_panel.clear()
        say(
            self._title,
            f"{protocol.stem}: {loaded.plan.title}, {counted(len(loaded.plan.trials), 'trial')}",
            "heading",
        )
        self._say_folder()
        self.refresh()
        return True

    def refresh(self) -> None:
        """Read what the study's folder holds, in the worker."""
        if self.out is not None and self.out.is_dir():
            self._worker.ask(
                "the study's folder", _headers, str(self.out), then=self._take_headers, key=_FOLDER
            )

    def show_state(self, state: BenchState) -> None:
        """Render the state: the rows, the one under way, and the fit of the last that has ended."""
        self.by_bench.setVisible(state.simulated)
        s = state.snapshot
        if self.out is None or Path(s.out) != self.out:
            return
        self.table.take_snapshot(s)
        ran, self._ran = self._ran, state.running
        if state.link == "died":
            self.table.run_died()
        if ran and not state.running:
            self.refresh()  # of a trial's attempts the best one counts, which the files tell
        place = self.table.place_of(s.trial)
        if state.running and place is not None and not self._bar.isVisible() and s.trial != self._shown_trial:
            self._shown_trial = s.trial
            self._view.scrollTo(self.table.index(place, 0), QAbstractItemView.ScrollHint.PositionAtCenter)
            self._view.selectRow(place)
        for ended in s.ended[-2:]:
            path = self.out / ended.file
            if ended.outcome == "complete" and self._worth_a_fit(path):
                self.fit_panel.show_trial(path)
            elif ended.outcome == "discarded":
                self.fit_panel.forget_trial(path)

    def chosen(self) -> StudyRow | None:
        """Return the row that is chosen; without a choice the last that was recorded."""
        rows = self._view.selectionModel().selectedRows() if self._view.selectionModel() else []
        if rows:
            return self.table.rows[rows[0].row()]
        recorded = [row for row in self.table.rows if row.file]
        return recorded[-1] if recorded else None

    def discard(self) -> None:
        """Ask for the reason, in a line below the table."""
        row = self._to_discard()
        if row is None:
            self.said.emit("discard: choose a trial that was recorded")
            return
        self._bar.ask(Path(row.file))

    def repeat(self) -> None:
        """Ask for the chosen trial to be recorded again, next."""
        row = self._to_discard()
        if row is None:
            self.said.emit("repeat: choose a trial of the study")
        else:
            self.repeat_asked.emit(row.name)

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self.table.restyle(theme)
        self.fit_panel.restyle(theme)

    def choose_protocol(self) -> None:
        """Ask for a protocol file."""
        ask_file(
            self,
            "Protocol of the study",
            self._habits.folder("protocols"),
            "Protocols (*.toml)",
            self._chosen_file,
        )

    def _chosen_file(self, path: Path) -> None:
        self._habits.used_folder("protocols", path.parent)
        self.load(path)

    def choose_folder(self) -> None:
        """Ask for the folder of the trials, where a study may be gone on with."""
        ask_folder(self, "Folder of the trials", self._habits.folder("studies"), self._chosen_folder)

    def _chosen_folder(self, folder: Path) -> None:
        kept = folder / "protocol.toml"
        if kept.exists():
            self._habits.used_folder("studies", folder.parent)
            self.load(kept, folder)
        elif self.protocol is not None:
            self._habits.used_folder("studies", folder)
            self.load(self.protocol, folder / self.protocol.stem)
        else:
            self.said.emit(f"{folder}: holds no study that could be gone on with: choose a protocol first")

    def _to_discard(self) -> StudyRow | None:
        row = self.chosen()
        if row is not None and row.file:
            return row
        recorded = [row for row in self.table.rows if row.file]
        return recorded[-1] if recorded else None

    def _restore(self) -> None:
        row = self.chosen()
        if row is None or row.state != "discarded":
            self.said.emit("keep after all: choose a discarded trial")
        else:
            self.restore_asked.emit(Path(row.file))

    def _take_headers(self, headers: list[Header]) -> None:
        self.table.take_headers(headers)
        self._say_folder()
        good = [Path(row.file) for row in self.table.rows if row.done and row.file]
        self.fit_panel.show_study(good)
        self._seen.update(good)

    def _worth_a_fit(self, path: Path) -> bool:
        """Whether a trial has not been shown in the fit panel yet."""
        fresh = path not in self._seen
        self._seen.add(path)
        return fresh

    def _show_chosen(self) -> None:
        row = self.chosen()
        if row is not None and row.file and row.done:
            self.fit_panel.show_trial(Path(row.file))

    def _say_folder(self) -> None:
        n, total = self.table.n_done(), len(self.table.rows)
        on = f": {n} of {total} are done, the run goes on from there" if n else ""
        say(self._folder, f"trials go to {self.out}{on}", "faint")

    def _make_view(self) -> QTableView:
        view = QTableView()
        view.setModel(self.table)
        view.setAccessibleName("trials of the study")
        view.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        view.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        view.setTabKeyNavigation(False)
        view.verticalHeader().hide()
        view.verticalHeader().setDefaultSectionSize(24)
        view.setWordWrap(False)
        header = view.horizontalHeader()
        for i, width in enumerate(_WIDTHS):
            header.resizeSection(i, width)
        header.setSectionResizeMode(QUALITY, QHeaderView.ResizeMode.Stretch)
        view.clicked.connect(lambda _: self._show_chosen())
        return view

    def _build(self) -> None:
        row = QHBoxLayout()
        row.addWidget(self.by_bench)
        row.addStretch(1)
        row.addWidget(button("Protocol ...", self.choose_protocol, tip="choose the protocol file of a study"))
        row.addWidget(
            button("Folder ...", self.choose_folder, tip="where the trials go; or a study to go on with")
        )
        left = QWidget()
        column = QVBoxLayout(left)
        column.setContentsMargins(6, 4, 4, 4)
        column.addWidget(self._title)
        column.addWidget(self._folder)
        column.addLayout(row)
        column.addWidget(self._view, 1)
        column.addWidget(self._bar)
        below = QHBoxLayout()
        below.addStretch(1)
        below.addWidget(button("Keep after all", self._restore, tip="take back that a trial was discarded"))
        column.addLayout(below)
        self.splitter = QSplitter(Qt.Orientation.Horizontal)
        self.splitter.addWidget(left)
        self.splitter.addWidget(self.fit_panel)
        self.splitter.setStretchFactor(0, 3)
        self.splitter.setStretchFactor(1, 2)
        self.splitter.setSizes([570, 380])
        self.splitter.setChildrenCollapsible(False)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.splitter)
        self.by_bench.hide()


def _headers(folder: str) -> list[Header]:
    """Return the headers of a study's folder; done in the worker."""
    listing = list_folder(Path(folder))
    return [*listing.known, *read_headers(listing.unread)]
