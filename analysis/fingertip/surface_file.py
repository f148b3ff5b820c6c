"""SURFACE.csv: how far skin was pressed in along the finger, under a line load."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.errors import BadInputError
from analysis.recordings.trial import FloatArray

POSITION, DEFLECTION, ERROR = "position_mm", "deflection_mm", "deflection_se_mm"
_FEWEST = 8
_LEAST_MM, _MOST_MM = 0.1, 30.0


@dataclass(frozen=True, slots=True)
class MeasuredSurface:
    """Deflection into the pad (N,) mm at places along the finger (N,) mm, from the line and towards the tip.

    ``error_mm`` (N,) is nan where the file has no standard errors.
    """

    file: str
    position_mm: FloatArray
    deflection_mm: FloatArray
    error_mm: FloatArray


def read_surface(path: Path, depth_mm: float) -> MeasuredSurface:
    """Read a deflection measured under a line pressed ``depth_mm`` deep.

    Columns ``position_mm`` and ``deflection_mm``, and ``deflection_se_mm`` where it is known; others are
    ignored. Raises BadInputError in one line for anything that can't be used.
    """
    rows = _rows(path)
    position, deflection, error = (np.array(column) for column in zip(*rows, strict=True))
    if len(rows) < _FEWEST:
        raise BadInputError(f"{path}: {len(rows)} places; at least {_FEWEST} are needed")
    if np.abs(position).max() > _MOST_MM:
        raise BadInputError(
            f"{path}: column {POSITION!r} reaches {np.abs(position).max():g}: longer than a finger tip; give mm"
        )
    if np.ptp(position) < _LEAST_MM:
        raise BadInputError(
            f"{path}: column {POSITION!r} spans only {np.ptp(position):g}: less than a tenth of a millimetre; give mm"
        )
    largest = float(np.abs(deflection).max())
    if largest > 3 * depth_mm:
        raise BadInputError(
            f"{path}: column {DEFLECTION!r} reaches {largest:g} under a line pressed {depth_mm:g} mm deep; "
            "give mm, or the depth by --depth"
        )
    if largest < depth_mm / 300:
        raise BadInputError(
            f"{path}: column {DEFLECTION!r} reaches only {largest:g} under a line pressed {depth_mm:g} mm deep; give mm"
        )
    if float(np.mean(deflection)) < 0:
        raise BadInputError(f"{path}: column {DEFLECTION!r} is negative: deflection counts into the pad")
    order = np.argsort(position)
    return MeasuredSurface(path.name, position[order], deflection[order], error[order])


def _rows(path: Path) -> list[tuple[float, float, float]]:
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as fault:
        raise BadInputError(
            f"{path}: can't be read: {getattr(fault, 'strerror', None) or 'not text'}"
        ) from fault
    reader = csv.DictReader(lines)
    there = [name.strip() for name in reader.fieldnames or ()]
    for name in (POSITION, DEFLECTION):
        if name not in there:
            stem = name.removesuffix("_mm")
            other = next((n for n in there if n.startswith(stem)), None)
            hint = f"; {other!r} is there: give millimetres" if other else ""
            raise BadInputError(f"{path}: column {name!r} is missing{hint}")
    reader.fieldnames = there
    found = []
    for number, row in enumerate(reader, start=2):
        try:
            values = [float(row[name]) for name in (POSITION, DEFLECTION)]
            error = float(row[ERROR]) if ERROR in there else math.nan
        except (TypeError, ValueError) as fault:
            raise BadInputError(f"{path}: line {number}: not a number: {fault}") from fault
        if not all(map(math.isfinite, values)) or (ERROR in there and not 0 < error < math.inf):
            raise BadInputError(
                f"{path}: line {number}: not a finite number, or an error that is not positive"
            )
        found.append((values[0], values[1], error))
    if not found:
        raise BadInputError(f"{path}: holds no row")
    return found
