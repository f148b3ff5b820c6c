"""Rows on disk: fits.csv as formats.md fixes it, fits.json with everything beside."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from analysis.relaxation.findings import Findings
from analysis.relaxation.joint import FingerSolid
from analysis.relaxation.published import CURVES, RESULTS, SOURCE, STIFFNESS_MN_PER_UM
from analysis.relaxation.result import NAMES, TrialFit

COLUMNS = (
    "file",
    "trial_id",
    "finger",
    "depth_mm",
    "repeat",
    "model",
    "n_samples",
    *(column for name in NAMES for column in (name, f"{name}_se")),
    "stiffness_mn_per_um",
    "rms_mn",
    "r2",
    "flags",
    "exponent",
    "exponent_se",
)


def write_csv(path: Path, rows: Sequence[TrialFit]) -> None:
    """Write fits.csv: one row a trial, empty but for labels and flags where there is no fit."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(_cells(row) for row in rows)


def _cells(row: TrialFit) -> dict[str, str]:
    cells: dict[str, object] = {
        "file": row.file,
        "trial_id": row.trial_id,
        "finger": row.finger,
        "depth_mm": row.depth_mm,
        "repeat": row.repeat,
        "model": row.model,
        "flags": row.flags,
    }
    if row.fitted:
        cells["n_samples"] = row.n_samples
        for name, estimate in row.estimates.items():
            cells[name], cells[f"{name}_se"] = estimate.value, estimate.se
        cells["stiffness_mn_per_um"] = row.stiffness_mn_per_um
        cells["rms_mn"], cells["r2"] = row.rms_mn, row.r2
        if row.exponent is not None:
            cells["exponent"], cells["exponent_se"] = row.exponent.value, row.exponent.se
    return {name: _text(cells.get(name)) for name in COLUMNS}


def _text(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def write_json(path: Path, found: Findings) -> None:
    """Write fits.json: every row with its solid and its checks, the study, the published results."""
    rows, study = found.rows, found.study
    document = {
        "format": "indenter-fits",
        "format_version": 1,
        "model": rows[0].model if rows else "",
        "trials": [_trial(row) for row in rows],
        "study": {
            "n_used": study.n_used,
            "n_rows": study.n_rows,
            "slope_mn_per_um": study.slope_mn_per_um,
            "slope_se_mn_per_um": study.slope_se,
            "groups": [asdict(group) for group in study.groups],
            "scatter": [
                {"depth_mm": depth, "columns": {name: asdict(s) for name, s in columns.items()}}
                for depth, columns in study.scatter.items()
            ],
        },
        "published": {
            "source": SOURCE,
            "n": CURVES,
            "stiffness_mn_per_um": STIFFNESS_MN_PER_UM,
            **{name: asdict(result) for name, result in RESULTS.items()},
        },
        "other_ramps": [asdict(prediction) for prediction in found.predictions],
        "joint": [_solid(solid) for solid in found.solids],
    }
    path.write_text(json.dumps(_plain(document), indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _solid(solid: FingerSolid) -> dict[str, Any]:
    joint = solid.joint
    return {
        "subject": solid.subject,
        "finger": solid.finger,
        "n": solid.n,
        "failure": solid.failure,
        "left_out": [list(one) for one in solid.left_out],
        "estimates": {name: asdict(e) for name, e in joint.estimates.items()} if joint else None,
        "repeat_se": joint.repeat_se if joint else None,
    }


def _trial(row: TrialFit) -> dict[str, Any]:
    fields: dict[str, Any] = {
        "file": row.file,
        "trial_id": row.trial_id,
        "subject": row.subject,
        "finger": row.finger,
        "depth_mm": row.depth_mm,
        "repeat": row.repeat,
        "model": row.model,
        "flags": row.flags,
        "failure": row.failure,
        "discarded": row.discarded,
    }
    if row.fitted:
        fields |= {
            "n_samples": row.n_samples,
            "ramp_s": row.ramp_s,
            "hold_s": row.hold_s,
            **{name: asdict(estimate) for name, estimate in row.estimates.items()},
            "stiffness_mn_per_um": row.stiffness_mn_per_um,
            "rms_mn": row.rms_mn,
            "r2": row.r2,
            "exponent": asdict(row.exponent) if row.exponent else None,
            "untold": dict(row.untold),
            "solid": asdict(row.solid) | {"covariance": row.solid.covariance.tolist()} if row.solid else None,
            "intervals_95": {name: asdict(interval) for name, interval in row.intervals.items()},
            "checks": [asdict(check) for check in row.checks],
        }
    return fields


def _plain(value: Any) -> Any:
    """Replace what JSON can't say (nan, infinity) by null."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
