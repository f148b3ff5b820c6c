"""Text recordings: a header line, then rows, columns by name."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analysis.errors import BadInputError
from analysis.recordings.importers.draft import Draft, even_grid, even_rate_hz, one_phase, refuse_dead_signals
from analysis.recordings.motion import phases_from_motion
from analysis.recordings.trial import FloatArray, Kind, NativeSamples

_NEEDED = ("time_s", "position_mm", "force_mn")
_OPTIONAL = ("command_mm",)
_FEWEST_ROWS = 8


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
    time_s, position_mm, force_mn = (table.columns[name] for name in _NEEDED)
    _check_time(path, time_s, table.lines)
    refuse_dead_signals(path, position_mm, force_mn)
    log = [f"columns read: {', '.join(table.columns)}; volts stand for units: 1 V is 1 mm, 1 V is 1 mN"]
    if table.ignored:
        log.append(f"columns ignored: {', '.join(table.ignored)}")
    if table.blank:
        log.append(f"blank lines skipped: {table.blank}")
    draft = _evenly_sampled(table.columns, log)
    fixed = one_phase(kind, len(draft.position_v))
    if fixed is not None:
        phases, line = fixed
    else:
        phases = phases_from_motion(draft.position_v, draft.sample_rate_hz)
        found = ", ".join(phase.name for phase in phases)
        line = f"phases found from the motion: {found or 'none, the motion shows no press and hold'}"
    return replace(draft, phases=phases, log=(*draft.log, line))


def _evenly_sampled(columns: dict[str, FloatArray], log: list[str]) -> Draft:
    time_s, position_mm, force_mn = (columns[name] for name in _NEEDED)
    command_mm = columns.get("command_mm")
    if time_s[0] != 0:
        log.append(f"time counts from the first sample; it was {time_s[0]:g} s in the file")
    elapsed_s = time_s - time_s[0]
    rate = even_rate_hz(elapsed_s)
    if rate is not None:
        log.append(f"evenly sampled: {len(time_s)} samples at {rate:g} Hz")
        return Draft(rate, position_mm, force_mn, command_mm, (), tuple(log))
    grid, rate = even_grid(elapsed_s)
    log.append(
        f"unevenly sampled: {len(time_s)} samples interpolated linearly onto {len(grid)} at {rate:g} Hz; "
        "the samples as they were taken are kept in /import"
    )
    return Draft(
        sample_rate_hz=rate,
        position_v=np.interp(grid, elapsed_s, position_mm),
        force_v=np.interp(grid, elapsed_s, force_mn),
        command_v=None if command_mm is None else np.interp(grid, elapsed_s, command_mm),
        phases=(),
        log=tuple(log),
        native=NativeSamples(elapsed_s, position_mm, force_mn),
    )


def _check_time(path: Path, time_s: FloatArray, lines: list[int]) -> None:
    if len(time_s) < _FEWEST_ROWS:
        raise BadInputError(
            f"{path}: has {len(time_s)} rows of samples: a recording needs {_FEWEST_ROWS} or more"
        )
    back = np.flatnonzero(np.diff(time_s) <= 0)
    if back.size:
        i = int(back[0])
        raise BadInputError(
            f"{path}: line {lines[i + 1]}: time_s is {time_s[i + 1]:g} after {time_s[i]:g}: "
            "it must rise from row to row, with enough digits"
        )


def _table(path: Path) -> _Table:
    rows = _rows(path)
    header_line, header = next(rows, (0, []))
    names = [name.strip() for name in header]
    _check_header(path, names)
    wanted = [(name, names.index(name)) for name in (*_NEEDED, *_OPTIONAL) if name in names]
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
    ignored = tuple(name for name in names if name not in (*_NEEDED, *_OPTIONAL) and name)
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
    missing = [name for name in _NEEDED if name not in names]
    if missing:
        found = ", ".join(names)[:120] or "nothing"
        hint = (
            "separate columns by commas, and " if len(names) == 1 and any(c in found for c in ";\t") else ""
        )
        raise BadInputError(
            f"{path}: line 1: lacks the column {', '.join(missing)} (found {found}): "
            f"{hint}convert to s, mm and mN and name the columns so"
        )
    twice = sorted({name for name in names if name in (*_NEEDED, *_OPTIONAL) and names.count(name) > 1})
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
