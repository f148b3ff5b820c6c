"""The study's page: one HTML file that holds its tables and figures and can be mailed."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from analysis.recordings.reading import read_trial
from analysis.relaxation.constants import ramp_bias
from analysis.relaxation.cross_prediction import CrossPrediction
from analysis.relaxation.figures import draw_all
from analysis.relaxation.findings import Findings
from analysis.relaxation.joint import FingerSolid
from analysis.relaxation.numbers import with_error
from analysis.relaxation.prediction import Curve, fitted_curve
from analysis.relaxation.profile import PROFILED
from analysis.relaxation.published import CURVES, RESULTS, SOURCE, STIFFNESS_MN_PER_UM
from analysis.relaxation.result import NAMES, TrialFit
from analysis.relaxation.study import COLUMNS, Group, Study, Summary, depth_level

_LABELS = {
    "A0_mn": "A0 (mN)",
    "A1_over_A0": "A1/A0",
    "A2_over_A0": "A2/A0",
    "t1_s": "t1 (s)",
    "t2_s": "t2 (s)",
    "stiffness_mn_per_um": "stiffness (mN/um)",
    "k0_mn_per_mm": "k0 (mN/mm)",
    "exponent": "p of d^p",
}
_SHARED = ("k0_mn_per_mm", "A1_over_A0", "A2_over_A0", "t1_s", "t2_s")
_CAPTIONS = {
    "relaxation": "Recorded force (points) and fit (lines), one trial a depth, with the residual below.",
    "stiffness": "A0 over depth with standard errors; line: its slope. The ramp model's A0 counts from the first "
    "touch, depth from where the approach stopped.",
    "parameters": "Times and amplitude ratios by depth, mean and sd (of a single trial: its standard error).",
}
_CAPTIONS_OF_FINGERS = {
    "stiffness": " Broken line: the published slope.",
    "parameters": " Colours: fingers; band: published.",
}
_MODEL_TEXTS = {
    "ramp": "Each fit is driven by the recorded motion (ramp model).",
    "step": "Each hold is taken as the answer to an ideal step, as published; that biases A2 and A1.",
}
_MOST_CURVES = 6


def write_page(out: Path, files: Sequence[Path], found: Findings) -> Path:
    """Draw the figures and write ``fits.html`` into ``out``; return its path.

    ``files`` (N,) belong to the rows (N,).
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    rows, study = found.rows, found.study
    figures = draw_all(out, rows, study, _examples(files, rows))
    of_fingers = any(row.finger for row in rows)
    environment = Environment(
        loader=PackageLoader("analysis.relaxation", "."), autoescape=True, undefined=StrictUndefined
    )
    html = environment.get_template("page.html.j2").render(
        study=study,
        n_failed=sum(not row.fitted for row in rows),
        n_discarded=sum(row.fitted and bool(row.discarded) for row in rows),
        n_flagged=sum(row.fitted and not row.discarded and bool(row.flags) for row in rows),
        model_text=_MODEL_TEXTS[rows[0].model],
        date=datetime.now().astimezone().strftime("%Y-%m-%d"),
        version=version("indenter"),
        source=SOURCE,
        curves=CURVES,
        beside=_beside(study) if of_fingers else [],
        of_fingers=of_fingers,
        bias=_bias(rows) if rows[0].model == "ramp" else [],
        figures=[
            {"data": base64.b64encode(path.read_bytes()).decode(), "caption": _caption(name, of_fingers)}
            for name, path in figures.items()
        ],
        column_labels=[_LABELS[column] for column in COLUMNS],
        groups=[_group_cells(group) for group in _shown_groups(study, of_fingers=of_fingers)],
        scatter=_scatter_cells(study),
        predictions=[_prediction_cells(prediction) for prediction in found.predictions],
        solids=[_solid_cells(solid) for solid in found.solids],
        intervals=[_interval_cells(row) for row in rows if row.intervals],
        interval_labels=[_LABELS[name] for name in PROFILED],
        solid_labels=[_LABELS[name] for name in _SHARED],
        flagged=[{"file": row.file, "lines": _flag_lines(row)} for row in rows if row.flags or row.untold],
        trial_labels=[_LABELS[name] for name in (*NAMES, "exponent")],
        logs=[{"file": row.file, "lines": row.log} for row in rows if row.log],
        trials=[_trial_cells(row) for row in rows if row.fitted],
    )
    path = out / "fits.html"
    path.write_text(html, encoding="utf-8")
    return path


def _caption(name: str, of_fingers: bool) -> str:
    return _CAPTIONS[name] + (_CAPTIONS_OF_FINGERS.get(name, "") if of_fingers else "")


def _examples(files: Sequence[Path], rows: Sequence[TrialFit]) -> list[tuple[str, Curve]]:
    """Return one fitted trial a depth, of the finger that has most depths, if possible without flags."""
    pairs = zip(files, rows, strict=True)
    used = [(file, row) for file, row in pairs if row.fitted and not row.discarded and not row.creep]
    by_finger: dict[str, dict[float, tuple[Path, TrialFit]]] = {}
    for file, row in sorted(used, key=lambda pair: bool(pair[1].flags)):
        by_finger.setdefault(row.finger, {}).setdefault(depth_level(row.depth_mm), (file, row))
    if not by_finger:
        return []
    chosen = max(by_finger.values(), key=len)
    return [
        (f"{depth:g} mm", fitted_curve(read_trial(file), row))
        for depth, (file, row) in sorted(chosen.items())[:_MOST_CURVES]
    ]


def _number(value: float | None, digits: int = 4) -> str:
    return "" if value is None else f"{value:.{digits}g}"


def _mean_sd(summary: Summary | None) -> str:
    return "" if summary is None else with_error(summary.mean, summary.sd)


def _beside(study: Study) -> list[dict[str, Any]]:
    overall = study.groups[-1].columns
    table = []
    for name, published in RESULTS.items():
        here = overall.get(name)
        table.append(
            {
                "label": _LABELS[name],
                "published": _number(published.mean),
                "published_sd": _number(published.sd),
                "mean": _number(here.mean if here else None),
                "sd": _number(here.sd if here else None, 2),
                "n": here.n if here else 0,
                "se": _number(here.mean_se if here else None, 2),
            }
        )
    table.append(
        {
            "label": "slope of A0 over depth (mN/um)",
            "published": _number(STIFFNESS_MN_PER_UM),
            "published_sd": "",
            "mean": _number(study.slope_mn_per_um),
            "sd": "",
            "n": study.n_used,
            "se": _number(study.slope_se, 2),
        }
    )
    return table


def _bias(rows: Sequence[TrialFit]) -> list[dict[str, str]]:
    """Return by depth what share of A1 and A2 a step fit would keep, from the mean times found here."""
    by_depth: dict[float, list[TrialFit]] = {}
    for row in rows:
        told = row.fitted and not row.discarded and not {"t1_s", "t2_s"} & row.untold.keys()
        # the formula is that of a flat punch and a ramp of constant speed
        if told and row.ramp_s and (row.solid is None or row.solid.exponent == 1.0):
            by_depth.setdefault(depth_level(row.depth_mm), []).append(row)
    table = []
    for depth, chosen in sorted(by_depth.items()):
        ramp_s = sum(row.ramp_s or 0.0 for row in chosen) / len(chosen)
        kept = {
            name: ramp_bias(ramp_s, sum(row.estimates[name].value for row in chosen) / len(chosen))
            for name in ("t1_s", "t2_s")
        }
        table.append(
            {
                "depth": f"{depth:g}",
                "ramp_ms": _number(1e3 * ramp_s, 3),
                "a1": f"{kept['t1_s']:.3f}",
                "a2": f"{kept['t2_s']:.3f}",
            }
        )
    return table


def _shown_groups(study: Study, *, of_fingers: bool) -> list[Group]:
    """Return the groups of the table; where no finger is named, those of depths alone."""
    if of_fingers:
        return list(study.groups)
    depths = [group for group in study.groups if group.finger is None and group.depth_mm is not None]
    return [*(depths if len(depths) > 1 else []), study.groups[-1]]


def _group_cells(group: Group) -> dict[str, Any]:
    return {
        "finger": "all" if group.finger is None else (group.finger or "all"),
        "depth": "all" if group.depth_mm is None else f"{group.depth_mm:g}",
        "sum": group.finger is None or group.depth_mm is None,
        "n": max((summary.n for summary in group.columns.values()), default=0),
        "cells": [_mean_sd(group.columns.get(column)) for column in COLUMNS],
    }


def _scatter_cells(study: Study) -> list[dict[str, Any]]:
    table = []
    for depth, columns in study.scatter.items():
        if not columns:
            continue
        for kind in ("between", "within"):
            cells = [
                _number(getattr(columns[column], kind) ** 0.5, 3) if column in columns else ""
                for column in COLUMNS
            ]
            table.append({"depth": "all" if depth is None else f"{depth:g}", "kind": kind, "cells": cells})
    return table


def _prediction_cells(item: CrossPrediction) -> dict[str, Any]:
    return {
        "fitted": item.fitted,
        "ramp": _number(item.ramp_s, 3),
        "other": item.other,
        "other_ramp": _number(item.other_ramp_s, 3),
        "rms": _number(item.rms_mn, 3),
        "share": _number(100.0 * item.share, 3),
        "peak": _number(100.0 * item.peak_share, 3),
        "r2": _number(item.r2, 4),
        "failed": item.failed,
    }


def _solid_cells(solid: FingerSolid) -> dict[str, Any]:
    name = " ".join(part for part in (solid.subject, solid.finger) if part) or "all"
    joint = solid.joint
    if joint is None:
        return {"finger": name, "n": 0, "cells": [], "failure": solid.failure}
    cells = [
        f"{with_error(joint.estimates[column].value, joint.estimates[column].se)} "
        f"({_number(joint.repeat_se[column], 2)})"
        for column in _SHARED
    ]
    return {"finger": name, "n": solid.n, "cells": cells, "failure": ""}


def _interval_cells(row: TrialFit) -> dict[str, Any]:
    cells = []
    for name in PROFILED:
        interval = row.intervals[name]
        high = _number(interval.high) if math.isfinite(interval.high) else "no bound"
        cells.append(f"{_number(interval.low)} to {high}")
    return {"file": row.file, "cells": cells}


def _flag_lines(row: TrialFit) -> list[str]:
    lines = [f"discarded: {row.discarded}"] if row.discarded else []
    lines += [f"creep: {row.creep}: the solid's constants are those of its creep"] if row.creep else []
    lines += [f"not fitted: {row.failure}"] if row.failure else []
    lines += [
        f"not told: {', '.join(_LABELS[name] for name in row.untold if row.untold[name] == reason)}: {reason}"
        for reason in dict.fromkeys(row.untold.values())
    ]
    return lines + [f"{check.name}: {check.text}" for check in row.checks if check.raised]


def _trial_cells(row: TrialFit) -> dict[str, Any]:
    return {
        "file": row.file,
        "finger": row.finger,
        "depth": _number(row.depth_mm, 3),
        "repeat": "" if row.repeat is None else row.repeat,
        "cells": [
            "" if e is None else with_error(e.value, e.se)
            for e in (*map(row.estimates.get, NAMES), row.exponent)
        ],
        "rms": _number(row.rms_mn, 3),
        "percent": _number(row.rms_percent, 2),
        "r2": _number(row.r2, 5),
    }
