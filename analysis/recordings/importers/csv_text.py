"""Text recordings with the names of the trial file: a header line, then rows, columns by name."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.errors import BadInputError
from analysis.recordings.importers.draft import Draft
from analysis.recordings.importers.headers import suggestion
from analysis.recordings.importers.sampled import NEEDED, OPTIONAL, draft_of_columns
from analysis.recordings.trial import FloatArray, Kind


@dataclass(frozen=True, slots=True)
class _Table:
    columns: dict[str, FloatArray]
    lines: list[int]
    ignored: tuple[str, ...]
    blank: int


def read_csv(path: Path, kind: Kind) -> Draft:
    """Read a text recording: time_s, position_mm, force_mn and, where it is there, command_mm.

    Unevenly spaced samples are interpolated onto an even grid and kept beside it as they were. Raises
    BadInputError that names the line.
    """
    table = _table(path)
    log = [f"columns read: {', '.join(table.columns)}; volts stand for units: 1 V is 1 mm, 1 V is 1 mN"]
    if table.ignored:
        log.append(f"columns ignored: {', '.join(table.ignored)}")
    if table.blank:
        log.append(f"blank lines skipped: {table.blank}")
    return draft_of_columns(path, table.columns, table.lines, kind, log)


def names_columns_so(path: Path) -> bool:
    """Whether the first line of a text names one of the columns as the trial file does."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            first = next((line for line in file if line.strip()), "")
    except (OSError, UnicodeDecodeError):
        return False
    return any(name in first for name in NEEDED)


def _table(path: Path) -> _Table:
    rows = _rows(path)
    header_line, header = next(rows, (0, []))
    names = [name.strip() for name in header]
    _check_header(path, names)
    wanted = [(name, names.index(name)) for name in (*NEEDED, *OPTIONAL) if name in names]
    values: list[list[float]] = []
    lines: list[int] = []
    last = header_line
    blank = header_line - 1
    for line, row in rows:
        blank += line - last - 1
        last = line
        if len(row) < len(names) or any(cell.strip() for cell in row[len(names) :]):
            raise BadInputError(
                f"{path}: line {line}: has {len(row)} values for {len(names)} columns: mend or remove the row"
            )
        values.append([_number(path, line, name, row[i]) for name, i in wanted])
        lines.append(line)
    columns = np.array(values, dtype=np.float64).reshape(len(values), len(wanted)).T
    ignored = tuple(name for name in names if name not in (*NEEDED, *OPTIONAL) and name)
    named = {name: np.ascontiguousarray(column) for (name, _), column in zip(wanted, columns, strict=True)}
    return _Table(named, lines, ignored, max(0, blank))


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield line number and cells of every row that is not blank."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file)
            for row in reader:
                if any(cell.strip() for cell in row):
                    yield reader.line_num, row
    except (UnicodeDecodeError, csv.Error) as error:
        raise BadInputError(
            f"{path}: is not a text file in UTF-8 ({error}): export it as CSV again"
        ) from error
    except OSError as error:
        raise BadInputError(f"{path}: can't be read ({error.strerror}): check the disk") from error


def _check_header(path: Path, names: list[str]) -> None:
    missing = [name for name in NEEDED if name not in names]
    if missing:
        found = ", ".join(names)[:120] or "nothing"
        hint = (
            "separate columns by commas, and " if len(names) == 1 and any(c in found for c in ";\t") else ""
        )
        raise BadInputError(
            f"{path}: line 1: lacks the column {', '.join(missing)} (found {found}): "
            f"{hint}name the columns so, or say which is which, as in {suggestion([names])}"
        )
    twice = sorted({name for name in names if name in (*NEEDED, *OPTIONAL) and names.count(name) > 1})
    if twice:
        raise BadInputError(f"{path}: line 1: has the column {twice[0]} twice: keep the right one")


def _number(path: Path, line: int, name: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError as error:
        shown = " ".join(cell.split())[:30]
        raise BadInputError(
            f"{path}: line {line}: {name} is {shown!r}, not a number: mend or remove the row"
        ) from error
    if not math.isfinite(value):
        raise BadInputError(f"{path}: line {line}: {name} is {cell.strip()}: mend or remove the row")
    return value
