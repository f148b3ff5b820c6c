"""The report's page: one HTML file, figures inside, for a scientist who does not know the method."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from analysis.mismatch.evidence.heldout import FEWEST_HELD_OUT
from analysis.mismatch.model.words import listed, spoken
from analysis.mismatch.report import wording
from analysis.mismatch.report.contents import Report, Window

VERDICTS = {
    "no_mismatch": "The simulation explains the recordings",
    "named": "Found what the simulation left out",
    "one_of": "Found, but more than one mechanism would explain it",
    "unknown": "Something differs that no mechanism of the library explains",
}
_CAPTIONS = {
    "trial": "One trial. Points: recorded force; broken line: the simulation; solid line: the simulation "
    "with what was left out. Below each, what is left. Where they differ most is marked, and enlarged on the "
    "right.",
    "residual": "What the simulation leaves unexplained, averaged over repeats of each condition and laid "
    "out by phase: noise averages out, mismatch stays. Above before, below after; phases with a significant "
    "window are shaded.",
    "position": "The lever's recorded position less what its nominal servo would do, averaged over trials.",
}


def write_page(path: Path, report: Report, figures: Mapping[str, Path]) -> None:
    """Write the report as one self-contained HTML file."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("analysis.mismatch.report", "."), autoescape=True, undefined=StrictUndefined
    )
    html = environment.get_template("report.html.j2").render(
        report=report,
        headline=VERDICTS[report.verdict],
        figures=[
            {"data": base64.b64encode(png.read_bytes()).decode(), "caption": _CAPTIONS[name], "name": name}
            for name, png in figures.items()
        ],
        windows=[_window_cells(w) for w in report.mismatch],
        remainder=[_window_cells(w) for w in report.remainder.where] if report.remainder else [],
        mechanisms=[
            {
                "name": spoken(m.name),
                "stage": m.stage,
                "explanation": m.explanation,
                "parameters": [
                    {"label": wording.symbol(name), "value": wording.with_error(q)}
                    for name, q in m.parameters.items()
                ],
                "alternatives": listed(
                    [
                        f"{spoken(a)} ({wording.percent(m.alternative_probabilities[a])})"
                        for a in m.alternatives
                    ],
                    "or",
                ),
                "p": wording.chance(m.p_value),
                "probability": wording.percent(m.probability),
            }
            for m in report.mechanisms
        ],
        tissue=_tissue_rows(report),
        hidden=[
            {"name": spoken(n.name), "reason": n.reason, "way": spoken(n.separated_by)}
            for n in report.not_identifiable
        ],
        sure=_sure_rows(report),
        explained=wording.percent(report.explained_share),
        tolerance=wording.force(report.tolerance_mn),
        left_over=wording.force(report.remainder.rms_mn) if report.remainder else "",
        chance=wording.chance(report.heldout.p_value) if report.n_trials >= FEWEST_HELD_OUT else "",
        separations=_separations(report),
        date=datetime.now().astimezone().strftime("%Y-%m-%d"),
        version=version("indenter"),
    )
    path.write_text(html, encoding="utf-8")


def _window_cells(window: Window) -> dict[str, Any]:
    position = window.signal == "position"
    return {
        "signal": window.signal,
        "phase": window.phase,
        "when": f"{max(window.start_s, 0.0):.3f} – {window.stop_s:.3f}",
        "mean": _signed(window.mean_residual_um, "um")
        if position
        else _force(window.mean_residual_mn, signed=True),
        "rms": _force(window.rms_mn),
        "share": f"{100 * window.share_of_mismatch:.2g} %",
        "conditions": window.conditions,
        "p": wording.chance(window.p_value),
    }


def _force(value_mn: float | None, *, signed: bool = False) -> str:
    return "" if value_mn is None else wording.force(value_mn, 3, signed=signed).replace(" ", "\u00a0")


def _signed(value: float | None, unit: str) -> str:
    return "" if value is None else f"{value:+.3g}\u00a0{unit}"


def _tissue_rows(report: Report) -> list[dict[str, str]]:
    rows = []
    for name, before in report.baseline_parameters.items():
        after = report.improved_parameters.get(name)
        if after is None:
            continue
        change = 100 * (before.value / after.value - 1.0) if after.value else 0.0
        rows.append(
            {
                "label": wording.symbol(name),
                "before": wording.with_error(before),
                "after": wording.with_error(after),
                "bias": wording.change_in_percent(change / 100) if abs(change) >= 0.01 else "none",
            }
        )
    return rows


def _sure_rows(report: Report) -> list[dict[str, str]]:
    what = "trials not fitted" if report.n_trials >= FEWEST_HELD_OUT else "the fitted trials themselves"
    compared = [(what, report.heldout)]
    return [
        {
            "what": what,
            "scheme": c.scheme,
            "n": str(c.n_trials),
            "before": wording.force(c.baseline_rms_mn, 4),
            "after": wording.force(c.improved_rms_mn, 4),
            "floor": wording.force(c.noise_floor_mn, 4),
            "chi2": f"{c.baseline_chi2:.3f} → {c.improved_chi2:.3f}",
        }
        for what, c in compared
    ]


def _separations(report: Report) -> Sequence[Mapping[str, str]]:
    if report.next_experiment is None:
        return []
    return [
        {"pair": spoken(pair), "sigmas": "> 1000" if value > 1000 else f"{value:.3g}"}
        for pair, value in report.next_experiment.predicted_separation.items()
    ]
