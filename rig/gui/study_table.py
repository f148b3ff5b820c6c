"""The study as a table: every trial of the plan with its state, its quality and what its fit found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt
from PySide6.QtGui import QColor

from analysis.relaxation.result import TrialFit
from analysis.relaxation.study import value_of
from rig.engine.attempts import attempt_number, planned_name
from rig.engine.progress import Snapshot
from rig.engine.states import State
from rig.engine.tasks import Ended
from rig.gui.bench_state import AT_REST
from rig.gui.jobs.headers import BEING_WRITTEN, Header
from rig.gui.theme import LIGHT, Theme
from rig.protocols.steps import PlannedTrial

Index = QModelIndex | QPersistentModelIndex


@dataclass(frozen=True, slots=True)
class StudyRow:
    """One planned trial; `file` is its newest attempt, `quality` what the fit's checks say."""

    number: int
    name: str
    finger: str
    depth_mm: float | None
    repeat: int | None
    state: str = "to do"
    file: str = ""
    quality: str = ""
    raised: bool = False
    a0_mn: float | None = None
    t1_s: float | None = None
    t2_s: float | None = None

    @property
    def done(self) -> bool:
        """Whether a good recording is there."""
        return self.state == "complete"


_COLUMNS: tuple[tuple[str, str], ...] = (
    ("#", "place in the order of the run"),
    ("finger", "finger, or what is pressed"),
    ("mm", "depth below the detected surface, mm"),
    ("rep.", "repeat of the same finger and depth"),
    ("state", "what became of it"),
    ("A0 mN", "elastic force of the fit"),
    ("t1 s", "slow relaxation time of the fit"),
    ("t2 s", "quick relaxation time of the fit"),
    ("quality", "what the checks of the fit say"),
)
STATE, QUALITY = 4, 8


class StudyTable(QAbstractTableModel):
    """Rows by planned trial; changed one at a time, so that nothing jumps while a run goes on."""

    def __init__(self) -> None:
        super().__init__()
        self.rows: list[StudyRow] = []
        self._place: dict[str, int] = {}
        self._told: tuple[Ended, ...] = ()
        self._theme = LIGHT

    def load(self, trials: Sequence[PlannedTrial]) -> None:
        """Show a plan, nothing of it done yet."""
        self.beginResetModel()
        self.rows = [
            StudyRow(
                i + 1,
                trial.name,
                trial.specimen.finger or trial.kind.replace("_", " "),
                trial.summary.depth_mm,
                trial.specimen.repeat,
            )
            for i, trial in enumerate(trials)
        ]
        self._place = {row.name: i for i, row in enumerate(self.rows)}
        self.endResetModel()

    def take_headers(self, headers: Sequence[Header]) -> None:
        """Take what the study's folder holds already: a good attempt counts, else the newest."""
        best: dict[str, tuple[tuple[bool, int], Header]] = {}
        for header in headers:
            stem = Path(header.path).stem
            rank = (header.status == "complete" and not header.discarded, attempt_number(stem))
            name = planned_name(stem)
            if name in self._place and (name not in best or rank > best[name][0]):
                best[name] = (rank, header)
        for name, (_, header) in best.items():
            row, state = self.rows[self._place[name]], _state_of(header)
            known = (row.state, row.file) == (state, header.path)
            said = header.problem if state == "unreadable" else header.discarded
            quality = said or (row.quality if known else "")
            self._change(name, state=state, file=header.path, quality=quality)

    def take_snapshot(self, snapshot: Snapshot) -> None:
        """Take what a run says that it has not said before: what has ended, and what is under way."""
        folder = Path(snapshot.out)
        fresh_ends = newly(self._told, snapshot.ended)
        self._told = snapshot.ended
        for name, ended in ((ended.trial, ended) for ended in fresh_ends):
            place = self._place.get(name)
            if place is None:
                continue
            row, file = self.rows[place], str(folder / ended.file)
            if not ended.file and ended.outcome == "cut short":
                if not row.done:
                    self._change(name, state="to do")
                continue
            # a good repeat stands, whatever is then said of an attempt before it
            if row.done and row.file != file and ended.outcome != "complete":
                continue
            fresh = {} if row.file == file else {"a0_mn": None, "t1_s": None, "t2_s": None, "raised": False}
            quality = ended.reason if ended.outcome != "complete" else (row.quality if not fresh else "")
            state = _AS_IN_FILES.get(ended.outcome, ended.outcome)
            self._change(name, state=state, file=file if ended.file else "", quality=quality, **fresh)
        last = snapshot.ended[-1].trial if snapshot.ended else ""
        for row in self.rows:
            under_way = snapshot.state not in AT_REST and row.name == snapshot.trial
            # what it ended as stands until it is recorded again
            if under_way and (row.name != last or snapshot.file):
                self._change(row.name, state=str(snapshot.state))
            elif not under_way and row.state in _UNDER_WAY:
                self._change(row.name, state="to do")

    def run_died(self) -> None:
        """Take it that what was under way is so no longer: the program that recorded it has died."""
        for row in self.rows:
            if row.state in _UNDER_WAY:
                self._change(row.name, state="to do")

    def take_fit(self, path: Path, fit: TrialFit) -> None:
        """Take the fit of a trial."""
        name = planned_name(path.stem)
        place = self._place.get(name)
        if place is None or self.rows[place].file not in {str(path), ""}:
            return
        raised = [check.text for check in fit.checks if check.raised]
        quality = "; ".join(raised) if fit.fitted else fit.failure
        self._change(
            name,
            quality=quality or "good",
            raised=bool(raised),
            a0_mn=value_of(fit, "A0_mn"),
            t1_s=value_of(fit, "t1_s"),
            t2_s=value_of(fit, "t2_s"),
        )

    def place_of(self, name: str) -> int | None:
        """Return the row of a planned trial."""
        return self._place.get(name)

    def n_done(self) -> int:
        """How many trials are recorded and good."""
        return sum(row.done for row in self.rows)

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours."""
        self._theme = theme

    def rowCount(self, parent: Index = QModelIndex()) -> int:  # noqa: N802, B008
        """Rows of the table."""
        return 0 if parent.isValid() else len(self.rows)

    def columnCount(self, parent: Index = QModelIndex()) -> int:  # noqa: N802, B008
        """Columns of the table."""
        return 0 if parent.isValid() else len(_COLUMNS)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = 0) -> Any:  # noqa: N802
        """Titles, and what they mean."""
        if orientation is not Qt.Orientation.Horizontal:
            return None
        if role == Qt.ItemDataRole.DisplayRole:
            return _COLUMNS[section][0]
        return _COLUMNS[section][1] if role == Qt.ItemDataRole.ToolTipRole else None

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        """Words, colours and tips."""
        if not index.isValid():
            return None
        row, column = self.rows[index.row()], index.column()
        if role == Qt.ItemDataRole.DisplayRole:
            return _cells(row)[column]
        if role == Qt.ItemDataRole.ToolTipRole:
            return f"{Path(row.file).name}\n{row.quality}".strip()
        if role == Qt.ItemDataRole.TextAlignmentRole and column in {0, 2, 3, 5, 6, 7}:
            return int(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        if role == Qt.ItemDataRole.ForegroundRole and column in {STATE, QUALITY}:
            return self._colour(row, column)
        return None

    def _colour(self, row: StudyRow, column: int) -> QColor | None:
        t = self._theme
        if column == QUALITY:
            return QColor(t.bad) if row.raised else None
        return {
            "complete": QColor(t.good),
            "to do": QColor(t.faint),
            "failed": QColor(t.bad),
            "aborted": QColor(t.bad),
            "cut off": QColor(t.bad),
            "discarded": QColor(t.note),
            "skipped": QColor(t.note),
        }.get(row.state, QColor(t.accent))

    def _change(self, name: str, **values: Any) -> None:
        place = self._place.get(name)
        if place is None:
            return
        changed = replace(self.rows[place], **values)
        if changed != self.rows[place]:
            self.rows[place] = changed
            self.dataChanged.emit(self.index(place, 0), self.index(place, len(_COLUMNS) - 1))


_UNDER_WAY: Mapping[str, State] = {str(state): state for state in State if state not in AT_REST}


_AS_IN_FILES = {"cut short": "aborted"}
"""A trial's state has one word, whether the run tells of it or its file."""


def _state_of(header: Header) -> str:
    if header.problem:
        return header.problem if header.problem == BEING_WRITTEN else "unreadable"
    if header.discarded:
        return "discarded"
    return "cut off" if header.status == "running" else header.status


def newly(before: tuple[Ended, ...], now: tuple[Ended, ...]) -> tuple[Ended, ...]:
    """Return what a list, to which is added at the end and dropped at the beginning, holds that is new."""
    for dropped in range(len(before) + 1):
        kept = len(before) - dropped
        if before[dropped:] == now[:kept]:
            return now[kept:]
    return now


def _cells(row: StudyRow) -> tuple[str, ...]:
    mark = {"complete": "✓ ", "discarded": "– ", "skipped": "– "}.get(row.state, "")
    mark = "✗ " if row.state in {"failed", "aborted", "cut off", "unreadable"} else mark
    return (
        str(row.number),
        row.finger,
        "" if row.depth_mm is None else f"{row.depth_mm:.2f}",
        "" if row.repeat is None else str(row.repeat),
        mark + row.state,
        _number(row.a0_mn),
        _number(row.t1_s),
        _number(row.t2_s),
        ("⚠ " if row.raised else "") + row.quality,
    )


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"
