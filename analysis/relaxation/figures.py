"""Figures in the manner of the published Figs. 4, 5b and 6, as PNG and as PDF with real text."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from analysis.figures import COLOURS, save_figures
from analysis.recordings.trial import FINGERS
from analysis.relaxation.prediction import Curve
from analysis.relaxation.published import RESULTS, STIFFNESS_MN_PER_UM
from analysis.relaxation.result import TrialFit
from analysis.relaxation.study import Study, depth_level

_GREY = "#999999"
_LABELS = {
    "t1_s": "t1 (s)",
    "t2_s": "t2 (s)",
    "A1_over_A0": "A1 / A0",
    "A2_over_A0": "A2 / A0",
}
_MOST_POINTS = 3000
_MOST_TICKS = 8  # that a small panel has room for


def draw_all(
    out: Path, rows: Sequence[TrialFit], study: Study, curves: Sequence[tuple[str, Curve]]
) -> dict[str, Path]:
    """Draw every figure that the rows allow into ``out``; return name -> PNG (the PDF lies beside)."""
    used = [row for row in rows if row.fitted and not row.discarded]
    elastic = [row for row in used if "A0_mn" in row.estimates]
    timed = [row for row in used if any(column in row.estimates for column in _LABELS)]
    drawers: dict[str, tuple[tuple[float, float], Callable[[Any], None]]] = {}
    if curves:
        lines = 1 if _alike(curves) else -(-len(curves) // 3)
        wide = 7.0 if lines == 1 and _alike(curves) else 9.0
        drawers["relaxation"] = (wide, 4.6 if lines == 1 else 3.6 * lines), lambda f: _relaxation(f, curves)
    if len({depth_level(row.depth_mm) for row in elastic}) > 1:
        drawers["stiffness"] = (4.6, 3.6), lambda figure: _stiffness(figure, elastic, study)
    if len(timed) > 1:
        drawers["parameters"] = (7.0, 5.2), lambda figure: _parameters(figure, timed)
    return save_figures(out, drawers)


def _relaxation(figure: Any, curves: Sequence[tuple[str, Curve]]) -> None:
    """Force in the hold and its fit, one trial a depth (as Fig. 4), with the residual below.

    Trials share their axes where they are alike in length and size; otherwise each has its own.
    """
    groups = [curves] if _alike(curves) else [[one] for one in curves]
    columns = min(len(groups), 3)
    lines = -(-len(groups) // columns)
    grid = figure.subplots(2 * lines, columns, squeeze=False, sharex="none", height_ratios=(3, 1) * lines)
    for number, group in enumerate(groups):
        line, column = divmod(number, columns)
        above, below = grid[2 * line, column], grid[2 * line + 1, column]
        _panel(above, below, group, number)
        above.tick_params(labelbottom=False)
        if column == 0:
            above.set_ylabel("force (mN)")
            below.set_ylabel("residual (mN)")
        if line == lines - 1 or number + columns >= len(groups):
            below.set_xlabel("time since the end of the ramp (s)")
    for empty in range(len(groups), lines * columns):
        line, column = divmod(empty, columns)
        grid[2 * line, column].set_visible(False)
        grid[2 * line + 1, column].set_visible(False)


def _alike(curves: Sequence[tuple[str, Curve]]) -> bool:
    lengths = [float(curve.time_s[-1]) - curve.hold_start_s for _, curve in curves]
    sizes = [float(np.ptp(curve.force_mn)) for _, curve in curves]
    return max(lengths) <= 3.0 * min(lengths) and max(sizes) <= 30.0 * min(sizes)


def _panel(above: Any, below: Any, curves: Sequence[tuple[str, Curve]], first_colour: int) -> None:
    for number, (label, curve) in enumerate(curves, start=first_colour):
        colour = COLOURS[number % len(COLOURS)]
        time_s = curve.time_s - curve.hold_start_s
        shown = time_s >= -max(1.3 * curve.ramp_s, min(1.0, 0.2 * float(time_s[-1])))
        stride = max(1, int(shown.sum()) // _MOST_POINTS)
        t, force, fitted = (values[shown][::stride] for values in (time_s, curve.force_mn, curve.fitted_mn))
        above.plot(t, force, ".", ms=1.2, color=colour, alpha=0.35, rasterized=True)
        above.plot(t, fitted, "-", lw=1.3, color=colour, label=label)
        below.plot(t, force - fitted, ".", ms=1.0, color=colour, alpha=0.35, rasterized=True)
    above.legend(title="depth")
    below.axhline(0.0, color="black", lw=0.6)
    above.set_xlim(*below.get_xlim())


def _stiffness(figure: Any, rows: Sequence[TrialFit], study: Study) -> None:
    """A0 over depth with its line (as Fig. 5b)."""
    axes = figure.subplots()
    scale, unit = _depth_unit(rows)
    for colour, finger, chosen in _by_finger(rows):
        depth_um = [scale * (row.depth_mm or 0.0) for row in chosen]
        a0 = [row.estimates["A0_mn"] for row in chosen]
        axes.errorbar(
            depth_um,
            [estimate.value for estimate in a0],
            [estimate.se for estimate in a0],
            fmt="o",
            ms=3.5,
            color=colour,
            alpha=0.7,
            lw=0.8,
            label=finger or None,
        )
    depths = np.array([scale * (row.depth_mm or 0.0) for row in rows])
    if study.slope_mn_per_um is not None:
        mean = float(np.mean([row.estimates["A0_mn"].value for row in rows]))
        span = np.array([depths.min(), depths.max()])
        slope = study.slope_mn_per_um * 1e3 / scale
        line = mean + slope * (span - depths.mean())
        axes.plot(span, line, "-", color="black", lw=1.0, label=f"{slope:.3g} mN/{unit}")
        if any(row.finger for row in rows):
            published = STIFFNESS_MN_PER_UM * 1e3 / scale
            label = f"published {published:.3g} mN/{unit}"
            axes.plot(span, published * span, "--", color=_GREY, lw=1.0, label=label)
    # one trial that tells nothing of A0 must not squeeze all others into a line
    estimates = [row.estimates["A0_mn"] for row in rows]
    values = [estimate.value for estimate in estimates]
    margin = 0.1 * (max(values) - min(values)) + 2.0 * float(np.median([e.se for e in estimates]))
    if margin > 0:
        axes.set_ylim(min(values) - margin, max(values) + margin)
    axes.set_xlabel(f"depth ({unit})")
    axes.set_ylabel("A0 (mN)")
    if axes.get_legend_handles_labels()[1]:
        axes.legend()


def _depth_unit(rows: Sequence[TrialFit]) -> tuple[float, str]:
    """Return what depths in mm are multiplied by on an axis, and the unit's name."""
    deepest_mm = max((row.depth_mm or 0.0) for row in rows)
    return (1e3, "um") if deepest_mm < 2.0 else (1.0, "mm")


def _parameters(figure: Any, rows: Sequence[TrialFit]) -> None:
    """Times and amplitude ratios by depth and finger, with the published mean and deviation (as Fig. 6)."""
    panels = figure.subplots(2, 2)
    scale, unit = _depth_unit(rows)
    of_fingers = any(row.finger for row in rows)
    depths = sorted({scale * depth_level(row.depth_mm) for row in rows})
    width = 0.8 * (min(np.diff(depths)) if len(depths) > 1 else max(depths[0], 1e-9))
    groups = list(_by_finger(rows))
    for axes, (column, label) in zip(panels.ravel(), _LABELS.items(), strict=True):
        if of_fingers:
            published = RESULTS[column]
            axes.axhspan(published.mean - published.sd, published.mean + published.sd, color="#eeeeee", lw=0)
            axes.axhline(published.mean, color=_GREY, lw=1.0, ls="--", label="published mean, sd")
        for number, (colour, finger, chosen) in enumerate(groups):
            place = (number + 0.5) / len(groups) - 0.5
            for depth in depths:
                told = [
                    row.estimates[column]
                    for row in chosen
                    if scale * depth_level(row.depth_mm) == depth and column in row.estimates
                ]
                if not told:
                    continue
                values = [estimate.value for estimate in told]
                spread = np.std(values, ddof=1) if len(values) > 1 else told[0].se
                axes.errorbar(
                    depth + place * width,
                    np.mean(values),
                    spread,
                    fmt="o",
                    ms=4,
                    color=colour,
                    lw=1.0,
                    capsize=2,
                    label=(finger or None) if depth == depths[0] else None,
                )
        axes.set_ylabel(label)
        axes.set_xlabel(f"depth ({unit})")
        apart = min(np.diff(depths), default=1.0) / max(depths[-1] - depths[0], 1e-300)
        if len(depths) == 1 or apart > 1.0 / _MOST_TICKS:
            axes.set_xticks(depths)
        if not axes.containers:
            axes.text(0.5, 0.5, "not told by these recordings", ha="center", transform=axes.transAxes)
    handles, labels = panels.ravel()[0].get_legend_handles_labels()
    if labels:
        figure.legend(handles, labels, loc="outside lower center", ncols=min(6, len(labels)))


def _by_finger(rows: Sequence[TrialFit]) -> Iterator[tuple[str, str, list[TrialFit]]]:
    fingers = sorted(
        {row.finger for row in rows}, key=lambda f: (FINGERS.index(f) if f in FINGERS else len(FINGERS), f)
    )
    for number, finger in enumerate(fingers):
        yield COLOURS[number % len(COLOURS)], finger, [row for row in rows if row.finger == finger]
