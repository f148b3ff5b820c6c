"""The study's table: means, scatter, and how much of the scatter lies between fingers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.recordings.trial import FINGERS, FloatArray
from analysis.relaxation.result import NAMES, TrialFit

COLUMNS = (*NAMES, "stiffness_mn_per_um")


@dataclass(frozen=True, slots=True)
class Summary:
    """Mean, standard deviation (None for one value), number, mean of the fits' own standard errors."""

    mean: float
    sd: float | None
    n: int
    mean_se: float | None


@dataclass(frozen=True, slots=True)
class Scatter:
    """One-way analysis of variance with fingers as a random effect, at one depth or over all.

    ``between`` and ``within`` are variances; ``between`` may come out at 0 where fingers differ no more than
    repeats do. ``fingers`` is the number of them.
    """

    between: float
    within: float
    fingers: int
    n: int


@dataclass(frozen=True, slots=True)
class Group:
    """The trials of one finger at one depth (or None: of all fingers, of all depths) summed up by column."""

    finger: str | None
    depth_mm: float | None
    columns: dict[str, Summary]


@dataclass(frozen=True, slots=True)
class Study:
    """The table of a study.

    ``groups`` finger by finger and depth by depth, then by depth over fingers, by finger over depths,
    and over all. ``scatter`` by depth (None: all depths) and column. ``slope_mn_per_um`` and its
    standard error: A0 over depth. ``n_used``, ``n_rows`` the trials in the table and in all.
    """

    groups: tuple[Group, ...]
    scatter: dict[float | None, dict[str, Scatter]]
    slope_mn_per_um: float | None
    slope_se: float | None
    n_used: int
    n_rows: int


def summarise(rows: Sequence[TrialFit]) -> Study:
    """Return the table of all rows that were fitted and not discarded."""
    used = [row for row in rows if row.fitted and not row.discarded]
    keys = [(row.finger, _depth_key(row)) for row in used]
    fingers = sorted({finger for finger, _ in keys}, key=_finger_order)
    depths = sorted({depth for _, depth in keys})
    groups = [
        *(
            _group(used, keys, finger, depth)
            for finger in fingers
            for depth in depths
            if (finger, depth) in keys
        ),
        *(_group(used, keys, None, depth) for depth in depths),
        *(_group(used, keys, finger, None) for finger in fingers),
        _group(used, keys, None, None),
    ]
    scatter: dict[float | None, dict[str, Scatter]] = {}
    for level in (*depths, None):
        chosen = [row for row, key in zip(used, keys, strict=True) if level is None or key[1] == level]
        scatter[level] = {
            column: found for column in COLUMNS if (found := _scatter(chosen, column)) is not None
        }
    slope, slope_se = _slope(used)
    return Study(tuple(groups), scatter, slope, slope_se, len(used), len(rows))


def value_of(row: TrialFit, column: str) -> float | None:
    """Return a column of a row, None where it has none."""
    if column == "stiffness_mn_per_um":
        return row.stiffness_mn_per_um
    estimate = row.estimates.get(column)
    return None if estimate is None else estimate.value


def depth_level(depth_mm: float | None) -> float:
    """Return a depth to two digits, mm: what counts as one depth in tables, on a finger as on a cell."""
    return float(f"{depth_mm or 0.0:.2g}")


def _depth_key(row: TrialFit) -> float:
    return depth_level(row.depth_mm)


def _finger_order(finger: str) -> tuple[int, str]:
    return (FINGERS.index(finger) if finger in FINGERS else len(FINGERS), finger)


def _group(
    used: Sequence[TrialFit], keys: Sequence[tuple[str, float]], finger: str | None, depth_mm: float | None
) -> Group:
    chosen = [
        row
        for row, key in zip(used, keys, strict=True)
        if (finger is None or key[0] == finger) and (depth_mm is None or key[1] == depth_mm)
    ]
    columns = {}
    for column in COLUMNS:
        values = _values(chosen, column)
        if values.size:
            errors = [row.estimates[column].se for row in chosen if column in row.estimates]
            columns[column] = Summary(
                mean=float(values.mean()),
                sd=float(values.std(ddof=1)) if values.size > 1 else None,
                n=int(values.size),
                mean_se=float(np.mean(errors)) if errors else None,
            )
    return Group(finger, depth_mm, columns)


def _values(rows: Sequence[TrialFit], column: str) -> FloatArray:
    return np.array([value for row in rows if (value := value_of(row, column)) is not None], dtype=float)


def _scatter(rows: Sequence[TrialFit], column: str) -> Scatter | None:
    """Return variance components by the method of moments; None without two fingers and a repeat."""
    fingers = sorted({row.finger for row in rows})
    cells = [values for f in fingers if (values := _values([r for r in rows if r.finger == f], column)).size]
    total = sum(cell.size for cell in cells)
    if len(cells) < 2 or total <= len(cells):
        return None
    grand = np.concatenate(cells).mean()
    within = float(sum(((cell - cell.mean()) ** 2).sum() for cell in cells)) / (total - len(cells))
    among = float(sum(cell.size * (cell.mean() - grand) ** 2 for cell in cells)) / (len(cells) - 1)
    typical = (total - sum(cell.size**2 for cell in cells) / total) / (len(cells) - 1)
    return Scatter(max((among - within) / typical, 0.0), within, len(cells), total)


def _slope(rows: Sequence[TrialFit]) -> tuple[float | None, float | None]:
    """Return the slope of A0 over nominal depth, mN/um, and its standard error."""
    rows = [row for row in rows if "A0_mn" in row.estimates]
    depth_um = 1e3 * np.array([row.depth_mm or 0.0 for row in rows])
    if len(rows) < 3 or np.ptp(depth_um) == 0.0:
        return None, None
    a0_mn = _values(rows, "A0_mn")
    centred = depth_um - depth_um.mean()
    slope = float(centred @ a0_mn / (centred @ centred))
    left = a0_mn - a0_mn.mean() - slope * centred
    return slope, float(np.sqrt(left @ left / (len(rows) - 2) / (centred @ centred)))
