"""Tables of strangers: separated text or spreadsheets, their columns and units as stated or as said."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from analysis.errors import BadInputError
from analysis.recordings.importers.draft import Draft
from analysis.recordings.importers.headers import find_column, recognised, split_unit, suggestion
from analysis.recordings.importers.instructions import NEEDED, QUANTITIES, Instructions, factor
from analysis.recordings.importers.rows import Cell, Rows, read_rows
from analysis.recordings.importers.sampled import draft_of_columns
from analysis.recordings.trial import FloatArray, Kind

_NAMES = {"time": "time_s", "position": "position_mm", "force": "force_mn", "command": "command_mm"}
_IN_UNITS = {"time": "s", "position": "mm", "force": "mN", "command": "mm"}
_SEARCHED = 200  # rows in which a header is looked for
_MOST_DOUBLED = 0.01  # of the rows; more are no slip of the recorder


def read_table(path: Path, kind: Kind, said: Instructions) -> list[Draft]:
    """Read the trials of a table. Raises BadInputError with the row, or with the options that are missing."""
    table = read_rows(path, said.sheet)
    wanted: Sequence[Mapping[str, Any]] = said.trials or ({},)
    drafts = []
    for number, own in enumerate(wanted, start=1):
        columns = {**said.columns, **{q: str(own[q]) for q in QUANTITIES if q in own}}
        draft = _one(path, table, columns, said.units, kind)
        name = str(own.get("name", f"{path.stem}-{number}" if len(wanted) > 1 else ""))
        drafts.append(replace(draft, name=name))
    return drafts


def states_its_columns(path: Path) -> bool:
    """Whether a table says by itself which columns are time, position and force, and in which units."""
    try:
        _header(read_rows(path), {}, {})
    except BadInputError:
        return False
    return True


def _one(path: Path, table: Rows, said: Mapping[str, str], units: Mapping[str, str], kind: Kind) -> Draft:
    place, columns = _header(table, said, units)
    header = table.rows[place][1] if place is not None else []
    data = table.rows[0 if place is None else place + 1 :]
    below = _units_below(data, columns)
    factors, shown = {}, []
    for quantity, column in columns.items():
        name = _text(header, column) or f"column {column + 1}"
        unit = units.get(quantity) or split_unit(name)[1] or below.get(quantity, "")
        size = factor(quantity, unit)
        if size is None:
            stated = f"in {unit!r}" if unit else "in no stated unit"
            raise BadInputError(
                f"{table.where}: {quantity} ({name}) is {stated}: say it, as in --unit {quantity}={_IN_UNITS[quantity]}"
            )
        factors[quantity] = size
        shown.append(f"{quantity} is {name!r} in {unit}")
    values, lines, notes = _values(table, data[1:] if below else data, columns)
    arrays = {_NAMES[quantity]: values[quantity] * factors[quantity] for quantity in columns}
    log = [f"{'; '.join(shown)}; volts stand for units: 1 V is 1 mm, 1 V is 1 mN", *table.notes]
    ignored = [_text(header, i) for i in range(len(header)) if i not in columns.values() and _text(header, i)]
    if ignored:
        log.append(f"columns ignored: {', '.join(ignored)}")
    if place:
        log.append(f"{place} row(s) above the header were left away")
    return draft_of_columns(path, arrays, lines, kind, [*log, *notes])


def _header(
    table: Rows, said: Mapping[str, str], units: Mapping[str, str]
) -> tuple[int | None, dict[str, int]]:
    """Return the header's place among the rows (None: none is needed) and quantity -> column."""
    numbered = {q: int(text) - 1 for q, text in said.items() if text.isdigit() and int(text) > 0}
    named = {q: text for q, text in said.items() if q not in numbered}
    best: dict[str, int] = {}
    for place, (_, row) in enumerate(table.rows[:_SEARCHED]):
        found = {q: column for q, text in named.items() if (column := find_column(row, text)) is not None}
        if len(found) < len(named):
            best = max(best, found, key=len)
            continue
        if named or not numbered:
            below = table.rows[place + 1][1] if place + 1 < len(table.rows) else []
            seen = {q: c for q, c in recognised(row, below, units).items() if q not in said}
            found = {**seen, **numbered, **found}
            if all(q in found for q in NEEDED):
                return place, found
            best = max(best, found, key=len)
    if not named and all(q in numbered for q in NEEDED):
        first = next((p for p, (_, row) in enumerate(table.rows) if _numeric(row, numbered)), None)
        if first is not None:
            return (first - 1 if first else None), numbered
    lacking = [q for q in NEEDED if q not in best]
    absent = [f"{q}={text}" for q, text in named.items() if q not in best]
    what = (
        f"no column {', '.join(absent)}"
        if absent
        else f"no column states {' and '.join(lacking)} with a unit"
    )
    heads = [cell for _, row in table.rows[:20] for cell in row if isinstance(cell, str)]
    raise BadInputError(
        f"{table.where}: {what} (found {', '.join(heads)[:160] or 'no names'}): say which is which, "
        f"as in {suggestion([row for _, row in table.rows[:_SEARCHED]])}"
    )


def _numeric(row: Sequence[Cell], columns: Mapping[str, int]) -> bool:
    return all(column < len(row) and isinstance(row[column], float) for column in columns.values())


def _text(row: Sequence[Cell], column: int) -> str:
    cell = row[column] if column < len(row) else None
    return cell.strip() if isinstance(cell, str) else ""


def _units_below(data: Sequence[tuple[int, Sequence[Cell]]], columns: Mapping[str, int]) -> dict[str, str]:
    """Return the units of a row of units right below the header, empty where there is none."""
    if not data:
        return {}
    row = data[0][1]
    units = {q: _text(row, column).strip("()[]") for q, column in columns.items()}
    stated = {q: unit for q, unit in units.items() if factor(q, unit) is not None}
    return stated if len(stated) == len(units) and not any(isinstance(c, float) for c in row) else {}


def _values(
    table: Rows, data: Sequence[tuple[int, Sequence[Cell]]], columns: Mapping[str, int]
) -> tuple[dict[str, FloatArray], list[int], list[str]]:
    """Return the columns (N,), the number of each row, and what was left away."""
    kept: list[list[float]] = []
    lines: list[int] = []
    doubled = 0
    for number, row in data:
        cells = [row[column] if column < len(row) else None for column in columns.values()]
        if all(cell is None for cell in cells):
            continue  # a neighbour in a wide table lasted longer
        numbers = [cell for cell in cells if isinstance(cell, float) and np.isfinite(cell)]
        if len(numbers) < len(cells):
            bad = next(
                i for i, cell in enumerate(cells) if not (isinstance(cell, float) and np.isfinite(cell))
            )
            raise BadInputError(
                f"{table.where}: line {number}: {list(columns)[bad]} is {str(cells[bad] or '')[:30]!r}, "
                "not a number: mend or remove the row"
            )
        if kept and numbers == kept[-1]:
            doubled += 1
            continue
        kept.append(numbers)
        lines.append(number)
    notes = [f"samples doubled: {doubled} row(s) equal to the one before were left away"] if doubled else []
    if doubled > max(1.0, _MOST_DOUBLED * len(kept)):
        raise BadInputError(
            f"{table.where}: {doubled} of {doubled + len(kept)} rows are equal to the one before: "
            "export it again with every digit of time"
        )
    array = np.array(kept, dtype=np.float64).reshape(len(kept), len(columns))
    return {q: np.ascontiguousarray(array[:, i]) for i, q in enumerate(columns)}, lines, notes
