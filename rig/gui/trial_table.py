"""The trials of a folder as a table: what each file says of itself, and its fit where there is one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, QSortFilterProxyModel, Qt

from analysis.relaxation.result import TrialFit
from analysis.relaxation.study import value_of
from rig.gui.jobs.headers import BEING_WRITTEN, Header

Index = QModelIndex | QPersistentModelIndex
READING = "reading ..."


@dataclass(frozen=True, slots=True)
class Row:
    """One file: its header, None until it is read, and its fit."""

    path: str
    header: Header | None = None
    fit: TrialFit | None = None


@dataclass(frozen=True, slots=True)
class Column:
    """A column: its heading, what it means, a row's value, how a number is written."""

    title: str
    tip: str
    value: Callable[[Row], str | float | None]
    number: str = ""


def _of_header(name: str) -> Callable[[Row], Any]:
    return lambda row: None if row.header is None else getattr(row.header, name)


def _of_fit(name: str) -> Callable[[Row], float | None]:
    return lambda row: None if row.fit is None else value_of(row.fit, name)


def _started(row: Row) -> str:
    if row.header is None or not row.header.started:
        return ""
    return datetime.fromisoformat(row.header.started).astimezone().strftime("%Y-%m-%d %H:%M:%S")


def state_words(row: Row) -> str:
    """Return how a trial ended, in words."""
    header = row.header
    if header is None:
        return READING
    if header.problem:
        return header.problem if header.problem == BEING_WRITTEN else f"unreadable: {header.problem}"
    if header.discarded:
        return f"discarded: {header.discarded}"
    return "cut off: bring it back by `indenter rescue`" if header.status == "running" else header.status


COLUMNS = (
    Column("file", "name of the trial file", lambda row: Path(row.path).stem),
    Column("finger", "whose skin was pressed", _of_header("finger")),
    Column("depth mm", "depth below the detected surface, mm", _of_header("depth_mm"), ".2f"),
    Column("rep.", "number of the repeat", _of_header("repeat"), "d"),
    Column("state", "how the recording ended, or why the trial does not count", state_words),
    Column("A0 mN", "elastic force at the end of a long hold, from the fit, mN", _of_fit("A0_mn"), ".1f"),
    Column("t1 s", "the longer time of relaxation, s", _of_fit("t1_s"), ".2f"),
    Column("t2 s", "the shorter time of relaxation, s", _of_fit("t2_s"), ".3f"),
    Column("flags", "what the fit's checks raise", lambda row: row.fit.flags if row.fit else ""),
    Column("started", "when the first sample was taken", _started),
    Column("ramp mm/s", "speed of the ramp, mm/s", _of_header("ramp_speed_mm_s"), ".3g"),
    Column("hold s", "length of the hold as planned, s", _of_header("hold_s"), ".3g"),
    Column("length s", "length of the recording, s", _of_header("duration_s"), ".2f"),
    Column("kind", "what was done", lambda row: row.header.kind.replace("_", " ") if row.header else ""),
    Column("site", "where on the finger", _of_header("site")),
    Column("subject", "whose finger", _of_header("subject")),
    Column("source", "card, simulated rig, or import", _of_header("source")),
)


class TrialTable(QAbstractTableModel):
    """All rows, in the order of one column; changes are told by rows, never by a reset.

    It sorts itself: a proxy would ask for 40,000 values to put 2,000 rows in order.
    """

    def __init__(self) -> None:
        super().__init__()
        self._rows: list[Row] = []
        self._places: dict[str, int] = {}
        self._texts: dict[str, str] = {}
        self._order: tuple[Column, bool] = (COLUMNS[0], False)

    @property
    def rows(self) -> Sequence[Row]:
        """All rows."""
        return self._rows

    def row_of(self, path: str) -> int | None:
        """Return the place of a file, None where it is not in the table."""
        return self._places.get(path)

    def clear(self) -> None:
        """Empty the table."""
        self.beginResetModel()
        self._rows, self._places, self._texts = [], {}, {}
        self.endResetModel()

    def add(self, rows: Sequence[Row]) -> None:
        """Append rows; files that are in the table already are left out."""
        fresh = [row for row in rows if row.path not in self._places]
        if not fresh:
            return
        first = len(self._rows)
        self.beginInsertRows(QModelIndex(), first, first + len(fresh) - 1)
        self._rows.extend(fresh)
        self._places |= {row.path: first + i for i, row in enumerate(fresh)}
        self.endInsertRows()
        self._sort()

    def remove(self, paths: Sequence[str]) -> None:
        """Take out files that are gone."""
        for place in sorted((self._places[path] for path in paths), reverse=True):
            self.beginRemoveRows(QModelIndex(), place, place)
            del self._rows[place]
            self.endRemoveRows()
        self._places = {row.path: i for i, row in enumerate(self._rows)}

    def set_headers(self, headers: Sequence[Header]) -> None:
        """Take what files say of themselves, anew or for the first time."""
        known = [header for header in headers if header.path in self._places]
        self.add([Row(header.path, header) for header in headers])
        self._put([Row(header.path, header, self._fit_of(header.path)) for header in known])

    def set_fits(self, fits: Mapping[str, TrialFit]) -> None:
        """Take fits by the files' paths."""
        places = {path: place for path in fits if (place := self._places.get(path)) is not None}
        self._put([Row(path, self._rows[place].header, fits[path]) for path, place in places.items()])

    def text(self, place: int) -> str:
        """Return all that a row says, in small letters, to be searched."""
        row = self._rows[place]
        if row.path not in self._texts:
            cells = [f"{column.title} {_shown(column, row)}" for column in COLUMNS]
            self._texts[row.path] = " | ".join(cells).lower()
        return self._texts[row.path]

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        """Order the rows by a column; rows that say nothing there come last."""
        if 0 <= column < len(COLUMNS):
            self._order = COLUMNS[column], order == Qt.SortOrder.DescendingOrder
            self._sort()

    def rowCount(self, parent: Index = QModelIndex()) -> int:  # noqa: N802, B008
        """Number of trials."""
        return 0 if parent.isValid() else len(self._rows)

    def columnCount(self, parent: Index = QModelIndex()) -> int:  # noqa: N802, B008
        """Number of columns."""
        return 0 if parent.isValid() else len(COLUMNS)

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        """What a cell shows, sorts by, says in its tool tip."""
        if not index.isValid():
            return None
        column, row = COLUMNS[index.column()], self._rows[index.row()]
        answer: Any = None
        if role == Qt.ItemDataRole.DisplayRole:
            answer = _shown(column, row)
        elif role == Qt.ItemDataRole.ToolTipRole:
            answer = row.path if index.column() == 0 else _shown(column, row) or column.tip
        elif role == Qt.ItemDataRole.TextAlignmentRole and column.number:
            answer = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        return answer

    def headerData(  # noqa: N802
        self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole
    ) -> Any:
        """A column's heading and what it means."""
        if orientation == Qt.Orientation.Horizontal and 0 <= section < len(COLUMNS):
            if role == Qt.ItemDataRole.DisplayRole:
                return COLUMNS[section].title
            if role == Qt.ItemDataRole.ToolTipRole:
                return COLUMNS[section].tip
        return None

    def _sort(self) -> None:
        column, descending = self._order
        stated = [row for row in self._rows if column.value(row) not in (None, "")]
        empty = [row for row in self._rows if column.value(row) in (None, "")]
        ordered = sorted(stated, key=lambda row: _sorted_by(column, row), reverse=descending) + empty
        if all(one is other for one, other in zip(ordered, self._rows, strict=True)):
            return
        self.layoutAboutToBeChanged.emit()
        before = self.persistentIndexList()
        paths = [self._rows[index.row()].path for index in before]
        self._rows = ordered
        self._places = {row.path: i for i, row in enumerate(ordered)}
        after = [
            self.index(self._places[path], index.column()) for path, index in zip(paths, before, strict=True)
        ]
        self.changePersistentIndexList(before, after)
        self.layoutChanged.emit()

    def _fit_of(self, path: str) -> TrialFit | None:
        return self._rows[self._places[path]].fit

    def _put(self, rows: Sequence[Row]) -> None:
        """Replace rows, and tell of each run of neighbours once: a sorted view orders itself anew each time."""
        places = sorted(self._places[row.path] for row in rows)
        for row in rows:
            self._rows[self._places[row.path]] = row
            self._texts.pop(row.path, None)
        first = 0
        for i, place in enumerate(places):
            if i + 1 == len(places) or places[i + 1] != place + 1:
                self.dataChanged.emit(self.index(places[first], 0), self.index(place, len(COLUMNS) - 1))
                first = i + 1
        if rows:
            self._sort()


def _shown(column: Column, row: Row) -> str:
    value = column.value(row)
    if value is None:
        return ""
    return format(value, column.number) if column.number else str(value)


def _sorted_by(column: Column, row: Row) -> Any:
    value = column.value(row)
    return value.lower() if isinstance(value, str) else value


class TrialFilter(QSortFilterProxyModel):
    """Shows the rows that hold every word asked for; "-word" leaves out the rows that hold it."""

    def __init__(self, table: TrialTable) -> None:
        super().__init__()
        self._table = table
        self._wanted: tuple[str, ...] = ()
        self._unwanted: tuple[str, ...] = ()
        self.setSourceModel(table)

    def look_for(self, text: str) -> None:
        """Filter by the words of a text; words in quotes belong together."""
        parts = _words(text.lower())
        self.beginFilterChange()
        self._wanted = tuple(part for part in parts if not part.startswith("-"))
        self._unwanted = tuple(part[1:] for part in parts if part.startswith("-") and len(part) > 1)
        self.endFilterChange()

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        """Have the table order itself."""
        self._table.sort(column, order)

    def filterAcceptsRow(self, source_row: int, source_parent: Index) -> bool:  # noqa: N802
        """Whether a row is shown."""
        if not self._wanted and not self._unwanted:
            return True
        text = self._table.text(source_row)
        return all(word in text for word in self._wanted) and not any(word in text for word in self._unwanted)


def _words(text: str) -> list[str]:
    pieces = text.split('"')
    found: list[str] = []
    for i, piece in enumerate(pieces):
        found += [piece] if i % 2 and piece else piece.split()
    return found
