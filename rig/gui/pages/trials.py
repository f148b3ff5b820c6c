"""The trials page: a folder to browse, filter, overlay, fit again, export, discard from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QItemSelectionModel, Qt, Signal
from PySide6.QtGui import QDragEnterEvent, QDropEvent, QHideEvent, QKeySequence, QShortcut, QShowEvent
from PySide6.QtWidgets import (
    QHBoxLayout,
    QLineEdit,
    QSplitter,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from rig.gui.asking import ask_folder
from rig.gui.controls import button, say, words
from rig.gui.file_opening import FileOpening
from rig.gui.fit_panel import FitPanel
from rig.gui.folder_reading import FolderReading
from rig.gui.habits import Habits
from rig.gui.jobs.headers import Header, Listing
from rig.gui.numbers import counted
from rig.gui.overlay import Chosen, Overlay
from rig.gui.theme import Theme
from rig.gui.trial_actions import TrialActions
from rig.gui.trial_table import Row, TrialFilter, TrialTable, state_words
from rig.gui.trial_view import COLUMNS_LAYOUT, trial_view
from rig.gui.worker import Worker

_NO_FOLDER = (
    "Open a folder of trials (Ctrl+O), or drop one here; .h5, .ddf and .csv files can be dropped too."
)


class TrialsPage(QWidget):
    """Browses trial files; everything that reads or writes one is done in the worker."""

    said = Signal(str)

    def __init__(self, worker: Worker, habits: Habits) -> None:
        super().__init__()
        self._worker = worker
        self._habits = habits
        self.folder: Path | None = None
        self._failure = ""
        self.table = TrialTable()
        self.filter = TrialFilter(self.table)
        self.overlay = Overlay(worker, habits)
        self.fit_panel = FitPanel(worker, habits, "fit of the trials page")
        self._reading = FolderReading(worker, self)
        self._opening = FileOpening(worker, self)
        self.commands = TrialActions(worker, habits, self.selected_or_shown, self.selected)
        self._build()
        self._connect()
        self.setAcceptDrops(True)
        self._tell()

    def open_folder(self, folder: Path) -> None:
        """Show the trials of a folder."""
        if folder != self.folder:
            self.table.clear()
            self.fit_panel.clear()
        self.folder = folder.absolute()
        self._failure = ""
        self._habits.used_folder("trials", self.folder)
        self._path.setText(str(self.folder))
        self._path.setCursorPosition(len(str(self.folder)))
        self._reading.read(self.folder)

    def refresh(self) -> None:
        """Look for new and changed files."""
        if self.folder is not None:
            self._reading.read(self.folder)

    def open_files(self, paths: Sequence[Path]) -> None:
        """Add files to the table and choose them; recordings of other programs are imported first."""
        self._failure = ""
        self._opening.open(paths, self.folder)

    def show_fit(self) -> None:
        """Show the fit of the current trial in place of the overlay."""
        self._tabs.setCurrentWidget(self.fit_panel)

    def selected(self) -> list[Row]:
        """The rows that are chosen, in the table's order."""
        chosen = self.view.selectionModel().selectedRows()
        places = sorted(index.row() for index in chosen)
        return [self._row_at(place) for place in places]

    def selected_or_shown(self) -> list[Row]:
        """The rows that are chosen; without a choice, all that the filter shows."""
        return self.selected() or [self._row_at(place) for place in range(self.filter.rowCount())]

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self.overlay.restyle(theme)
        self.fit_panel.restyle(theme)

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:  # noqa: N802
        """Take files and folders."""
        if event.mimeData().hasUrls():
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:  # noqa: N802
        """Open what was dropped."""
        paths = [Path(url.toLocalFile()) for url in event.mimeData().urls() if url.isLocalFile()]
        folders = [path for path in paths if path.is_dir()]
        event.acceptProposedAction()
        if folders:
            self.open_folder(folders[0])
        self.open_files([path for path in paths if path not in folders])

    def showEvent(self, event: QShowEvent) -> None:  # noqa: N802
        """Look for trials recorded meanwhile; the first time, open the folder that was open last."""
        super().showEvent(event)
        last = self._habits.folder("trials")
        if self.folder is None and last is not None and not self.table.rows:
            self.open_folder(last)
        else:
            self.refresh()

    def hideEvent(self, event: QHideEvent) -> None:  # noqa: N802
        """Remember the layout."""
        super().hideEvent(event)
        self._habits.keep_layout(COLUMNS_LAYOUT, bytes(self.view.horizontalHeader().saveState().data()))
        self._habits.keep_layout("trials.split", bytes(self._split.saveState().data()))

    def _build(self) -> None:
        self._path = QLineEdit()
        self._path.setReadOnly(True)
        self._path.setPlaceholderText("no folder is open")
        self._path.setAccessibleName("folder of trials")
        self._search = QLineEdit()
        self._search.setClearButtonEnabled(True)
        self._search.setPlaceholderText("filter (Ctrl+F): index 0.40 -discarded")
        self._search.setAccessibleName("filter")
        self._search.setToolTip(
            'rows that hold every word; -word leaves rows out; "two words" belong together'
        )
        self._count = words("", "faint")
        self._count.setSizePolicy(
            self._count.sizePolicy().Policy.Ignored, self._count.sizePolicy().Policy.Fixed
        )
        self.view = trial_view(self.filter, self._habits)
        top = QHBoxLayout()
        top.addWidget(
            button("&Open folder …", self._ask_folder, tip="show another folder's trials", key="Ctrl+O")
        )
        top.addWidget(self._path, 1)
        top.addWidget(button("&Refresh", self.refresh, tip="look for new and changed files"))
        left = QWidget()
        column = QVBoxLayout(left)
        column.setContentsMargins(0, 0, 4, 0)
        column.addLayout(top)
        column.addWidget(self._search)
        column.addWidget(self.view, 1)
        column.addWidget(self._count)
        column.addWidget(self.commands)
        self._tabs = QTabWidget()
        self._tabs.addTab(self.overlay, "O&verlay")
        self._tabs.addTab(self.fit_panel, "F&it")
        self._split = QSplitter(Qt.Orientation.Horizontal)
        self._split.addWidget(left)
        self._split.addWidget(self._tabs)
        self._split.setSizes([600, 640])
        self._split.setChildrenCollapsible(False)
        state = self._habits.layout("trials.split")
        if state is not None:
            self._split.restoreState(state)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(6, 6, 6, 6)
        layout.addWidget(self._split)

    def _connect(self) -> None:
        self._search.textChanged.connect(self._look_for)
        focus = QShortcut(QKeySequence("Ctrl+F"), self)
        focus.activated.connect(self._search.setFocus)
        self.view.selectionModel().selectionChanged.connect(lambda *_: self._chosen())
        self.view.selectionModel().currentRowChanged.connect(lambda *_: self._current())
        self.view.doubleClicked.connect(lambda _: self.show_fit())
        self._tabs.currentChanged.connect(lambda _: self._current())
        self.overlay.picked.connect(self._pick)
        self._reading.listed.connect(self._listed)
        self._reading.headers.connect(self._read)
        self._reading.done.connect(self._tell)
        self._opening.headers.connect(self._opened)
        for source in (self._reading, self._opening):
            source.failed.connect(self._failed)
        for take in (self.table.set_fits, self.fit_panel.know):
            self.commands.fitted.connect(take)
        self.commands.marked.connect(self._marked)
        self.fit_panel.fitted.connect(lambda path, row: self.table.set_fits({str(path): row}))
        for part in (self.overlay, self.fit_panel, self.commands, self._opening):
            part.said.connect(self.said)
        self.commands.overlaid = lambda: (self.overlay.axes, self.overlay.groups)

    def _ask_folder(self) -> None:
        start = self.folder or self._habits.folder("trials")
        ask_folder(self, "Folder of trials", start, self.open_folder)

    def _listed(self, listing: Listing) -> None:
        there = {*listing.unread, *(header.path for header in listing.known)}
        gone = [row.path for row in self.table.rows if row.path not in there and self._inside(row.path)]
        self.table.remove(gone)
        self.table.set_headers(listing.known)
        self.table.add([Row(path) for path in listing.unread])
        self._tell()

    def _inside(self, path: str) -> bool:
        return self.folder is not None and self.folder in Path(path).parents

    def _read(self, headers: Sequence[Header]) -> None:
        self.table.set_headers(headers)
        read = {header.path for header in headers}
        if any(row.path in read for row in self.selected()):
            self._chosen()  # chosen before it was known what it is
        self._tell()

    def _opened(self, headers: Sequence[Header]) -> None:
        self.table.set_headers(headers)
        self._select({header.path for header in headers})
        self._tell()

    def _marked(self, headers: Sequence[Header]) -> None:
        self.table.set_headers(headers)
        self._reading.learned(headers)
        for header in headers:
            if header.discarded:
                self.fit_panel.forget_trial(Path(header.path))
        self._tell()

    def _failed(self, problem: str) -> None:
        self._failure = problem
        self._tell()
        self.said.emit(problem)

    def _look_for(self, text: str) -> None:
        self.filter.look_for(text)
        self._tell()

    def _row_at(self, place: int) -> Row:
        return self.table.rows[self.filter.mapToSource(self.filter.index(place, 0)).row()]

    def _chosen(self) -> None:
        rows = [row for row in self.selected() if row.header is not None and not row.header.problem]
        self.overlay.show_chosen(
            [
                Chosen(row.path, row.header.finger, row.header.depth_mm, Path(row.path).stem)
                for row in rows
                if row.header is not None
            ]
        )
        self._tell()

    def _current(self) -> None:
        index = self.view.currentIndex()
        if not index.isValid():
            return
        row = self._row_at(index.row())
        self.overlay.highlight(row.path)
        if self._tabs.currentWidget() is self.fit_panel:
            self.fit_panel.show_trial(Path(row.path))

    def _pick(self, path: str) -> None:
        """Make the trial of a clicked curve the current one, and keep the choice."""
        place = self.table.row_of(path)
        if place is not None:
            index = self.filter.mapFromSource(self.table.index(place, 0))
            self.view.selectionModel().setCurrentIndex(index, QItemSelectionModel.SelectionFlag.NoUpdate)
            self.view.scrollTo(index)
            self.said.emit(f"{Path(path).stem}: {state_words(self.table.rows[place])}")

    def _select(self, paths: set[str]) -> None:
        flags = QItemSelectionModel.SelectionFlag.Select | QItemSelectionModel.SelectionFlag.Rows
        for path in paths:
            place = self.table.row_of(path)
            if place is not None:
                self.view.selectionModel().select(
                    self.filter.mapFromSource(self.table.index(place, 0)), flags
                )

    def _tell(self) -> None:
        """Say what the table holds, or what to do where it is empty."""
        read, in_all = self._reading.progress
        chosen = len(self.view.selectionModel().selectedRows())
        if self._failure:
            say(self._count, self._failure, "bad")
        elif self.folder is None and not self.table.rows:
            say(self._count, _NO_FOLDER, "note")
        elif not self.table.rows:
            say(self._count, "No trial files (*.h5) here: open another folder, or run a protocol.", "note")
        else:
            text = (
                f"{self.filter.rowCount()} of {counted(len(self.table.rows), 'trial')} shown, {chosen} chosen"
            )
            reading = f"; reading {read} of {in_all}" if read < in_all else ""
            say(self._count, text + reading, "faint")
