"""Rows of cells from whatever holds a table: separated text, or a spreadsheet."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from analysis.errors import BadInputError

SPREADSHEETS = (".xlsx", ".xlsm", ".xls", ".xlsb", ".ods")
TEXTS = (".csv", ".txt", ".tsv", ".dat")
_SEPARATORS = "\t;|,"  # the comma last

Cell = str | float | None


@dataclass(frozen=True, slots=True)
class Rows:
    """The rows (each with its number from 1) of a table; ``where`` says which, ``notes`` how it was read."""

    where: str
    rows: list[tuple[int, list[Cell]]]
    notes: tuple[str, ...]


def read_rows(path: Path, sheet: str = "") -> Rows:
    """Return the rows of a table that are not blank. Raises BadInputError where it can't be read."""
    if path.suffix.lower() in SPREADSHEETS:
        return _spreadsheet(path, sheet)
    if sheet:
        raise BadInputError(f"{path}: is a text and has no sheets: leave --sheet away")
    return _text(path)


def _spreadsheet(path: Path, sheet: str) -> Rows:
    from python_calamine import CalamineError, CalamineWorkbook, WorksheetNotFound

    try:
        book = CalamineWorkbook.from_path(path)
        names = [name for name in book.sheet_names if not sheet or name == sheet]
        if not names:
            shown = ", ".join(book.sheet_names)
            raise BadInputError(f"{path}: has no sheet named {sheet!r}: it has {shown}")
        tables = {name: book.get_sheet_by_name(name).to_python(skip_empty_area=False) for name in names}
    except (CalamineError, WorksheetNotFound, OSError, ValueError) as error:
        reason = " ".join(str(error).split())[:120]
        raise BadInputError(
            f"{path}: can't be read as a spreadsheet ({reason}): save it again as .xlsx"
        ) from error
    filled = [
        name for name, table in tables.items() if any(_cell(c) is not None for row in table for c in row)
    ]
    if not filled:
        raise BadInputError(f"{path}: its sheets are empty: save it again with the recording in one")
    if len(filled) > 1:
        shown = ", ".join(filled)
        raise BadInputError(f"{path}: has sheets {shown}: say which, as in --sheet {filled[0]!r}")
    rows = [(number, [_cell(c) for c in row]) for number, row in enumerate(tables[filled[0]], start=1)]
    return Rows(
        f"{path}: sheet {filled[0]!r}",
        [(number, row) for number, row in rows if any(cell is not None for cell in row)],
        (f"read from the sheet {filled[0]!r}",),
    )


def _cell(raw: object) -> Cell:
    if isinstance(raw, bool) or raw is None:
        return None
    if isinstance(raw, int | float):
        return float(raw)
    text = str(raw).strip()
    return text or None


def _text(path: Path) -> Rows:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadInputError(f"{path}: can't be read ({error.strerror}): check the disk") from error
    notes: list[str] = []
    encoding = "utf-16" if data.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError:
        text = data.decode("cp1252", errors="replace")
        notes.append("the text is not UTF-8, taken for that of Windows (cp1252)")
    if "\0" in text:
        raise BadInputError(f"{path}: is not a text: export it as CSV again")
    lines = text.splitlines()
    separator = _separator(lines[:200])
    comma = separator != "," and not any("." in line for line in lines[len(lines) // 2 :][:50])
    if comma and any("," in line for line in lines[len(lines) // 2 :][:50]):
        notes.append("decimal commas")
    else:
        comma = False
    notes.append(f"columns separated by {'tabs' if separator == chr(9) else repr(separator)}")
    rows: list[tuple[int, list[Cell]]] = []
    try:
        for number, cells in enumerate(csv.reader(lines, delimiter=separator), start=1):
            row = [_of_text(cell, comma=comma) for cell in cells]
            if any(cell is not None for cell in row):
                rows.append((number, row))
    except csv.Error as error:
        raise BadInputError(f"{path}: can't be read as a table ({error}): export it as CSV again") from error
    return Rows(str(path), rows, tuple(notes))


def _separator(lines: list[str]) -> str:
    """Return the mark that stands in most lines; a comma may be a decimal one where another does as well."""
    filled = [line for line in lines if line.strip()]
    usual = [mark for mark in _SEPARATORS if 2 * sum(mark in line for line in filled) > len(filled)]
    return usual[0] if usual else ","


def _of_text(cell: str, *, comma: bool) -> Cell:
    text = cell.strip()
    if not text:
        return None
    try:
        return float(text.replace(",", ".") if comma else text)
    except ValueError:
        return text
