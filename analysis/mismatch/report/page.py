"""The report's page: one HTML file, figures inside, for a scientist who does not know the method."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from analysis.mismatch.levels import FEWEST_HELD_OUT
from analysis.mismatch.model.words import listed, spoken
from analysis.mismatch.report import amounts
from analysis.mismatch.report.contents import Report, Window
from analysis.mismatch.report.setting import fitting
from analysis.mismatch.report.wording import constants_told

VERDICTS = {
    "no_mismatch": "The simulation explains the recordings",
    "named": "Found what the simulation left out",
    "one_of": "Found, but more than one mechanism would explain it",
    "unknown": "Something differs that no mechanism of the library explains",
}
_UNTOLD = "does not show"
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
            {
                "data": base64.b64encode(png.read_bytes()).decode(),
                "caption": fitting(_CAPTIONS[name], report.setting),
                "name": name,
            }
            for name, png in figures.items()
        ],
        windows=[_window_cells(w) for w in windows_of(report.mismatch, after_naming=False)],
        left=[_window_cells(w) for w in windows_of(report.mismatch, after_naming=True)],
        remainder=[_window_cells(w) for w in report.remainder.where] if report.remainder else [],
        mechanisms=[
            {
                "name": spoken(m.name),
                "stage": m.stage,
                "explanation": m.explanation,
                "parameters": [
                    {"label": amounts.symbol(name), "value": amounts.with_error(q)}
                    for name, q in m.parameters.items()
                ],
                "alternatives": listed(
                    [
                        f"{spoken(a)} ({amounts.percent(m.alternative_probabilities[a])})"
                        for a in m.alternatives
                    ],
                    "or",
                ),
                "p": amounts.chance(m.p_value),
                "probability": amounts.percent(m.probability),
            }
            for m in report.mechanisms
        ],
        tissue=_tissue_rows(report),
        hidden=[
            {
                "name": spoken(n.name),
                "reason": n.reason,
                "way": fitting(spoken(n.separated_by), report.setting),
            }
            for n in report.not_identifiable
        ],
        sure=_sure_rows(report),
        explained=amounts.percent(report.explained_share),
        tolerance=amounts.force(report.tolerance_mn),
        left_over=amounts.force(report.remainder.rms_mn) if report.remainder else "",
        left_of_peak=amounts.percent(report.remainder.rms_mn / report.peak_force_mn)
        if report.remainder
        else "",
        share_left=amounts.percent(report.remainder.share) if report.remainder else "",
        of_peak=_of_peak(report),
        floor_source=_floor_source(report),
        say=lambda text: fitting(text, report.setting),
        chance=amounts.chance(report.heldout.p_value) if report.n_trials >= FEWEST_HELD_OUT else "",
        separations=_separations(report),
        date=datetime.now().astimezone().strftime("%Y-%m-%d"),
        version=version("indenter"),
    )
    path.write_text(html, encoding="utf-8")


def windows_of(windows: Sequence[Window], *, after_naming: bool) -> list[Window]:
    """Return the windows before or after naming."""
    return [w for w in windows if w.after_naming == after_naming]


def _of_peak(report: Report) -> str:
    """Say what the errors are of the peak force."""
    h = report.heldout
    shares = [amounts.percent(rms / report.peak_force_mn) for rms in (h.baseline_rms_mn, h.improved_rms_mn)]
    floor = amounts.percent(h.noise_floor_mn / report.peak_force_mn)
    peak = amounts.force(report.peak_force_mn, 3)
    return f"Of the largest force ({peak}) that is {shares[0]} before, {shares[1]} after, and {floor} noise."


def _floor_source(report: Report) -> str:
    """Say where the noise floor comes from."""
    if report.n_trials >= FEWEST_HELD_OUT:
        return (
            "The noise floor was measured on these recordings while the drive rests: it is what differs between "
            "repeats of one motion or, where a motion was run once, what its fit leaves."
        )
    return "The noise floor was measured on these recordings as what the fit leaves while the drive rests."


def _window_cells(window: Window) -> dict[str, Any]:
    position = window.signal == "position"
    return {
        "signal": window.signal,
        "phase": window.phase,
        "when": f"{max(window.start_s, 0.0):.3f} – {window.stop_s:.3f}",
        "mean": _signed(window.mean_residual_um, "um")
        if position
        else _force(window.mean_told_mn, signed=True),
        "rms": _force(window.rms_mn),
        "share": amounts.percent(window.share_of_mismatch),
        "conditions": window.conditions,
        "p": amounts.chance(window.p_value),
    }


def _force(value_mn: float | None, *, signed: bool = False) -> str:
    return "" if value_mn is None else amounts.force(value_mn, 3, signed=signed).replace(" ", "\u00a0")


def _signed(value: float | None, unit: str) -> str:
    return "" if value is None else f"{value:+.3g}\u00a0{unit}"


def _tissue_rows(report: Report) -> list[dict[str, str]]:
    rows = []
    told = constants_told(report.baseline_parameters), constants_told(report.improved_parameters)
    for name, before in report.baseline_parameters.items():
        after = report.improved_parameters.get(name)
        if after is None:
            continue
        change = 100 * (before.value / after.value - 1.0) if after.value else 0.0
        rows.append(
            {
                "label": amounts.symbol(name),
                "before": amounts.with_error(before) if name in told[0] else _UNTOLD,
                "after": amounts.with_error(after) if name in told[1] else _UNTOLD,
                "bias": ""
                if name not in told[0] & told[1]
                else amounts.change_in_percent(change / 100)
                if abs(change) >= 0.01
                else "none",
            }
        )
    return rows


def _sure_rows(report: Report) -> list[dict[str, str]]:
    before, after, noise = amounts.errors(report.heldout)
    return [
        {
            "what": "trials not fitted"
            if report.n_trials >= FEWEST_HELD_OUT
            else "the fitted trials themselves",
            "scheme": report.heldout.scheme,
            "n": str(report.heldout.n_trials),
            "before": before,
            "after": after,
            "floor": noise,
            "chi2": f"{report.heldout.baseline_chi2:.4g} → {report.heldout.improved_chi2:.4g}",
        }
    ]


def _separations(report: Report) -> Sequence[Mapping[str, str]]:
    if report.next_experiment is None:
        return []
    return [
        {"pair": spoken(pair), "sigmas": "> 1000" if value > 1000 else f"{value:.3g}"}
        for pair, value in report.next_experiment.predicted_separation.items()
    ]
