"""The report's figures: one trial in full, the mean residual by phase, the position channel."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.figures import BLUE, COLOURS, VERMILLION, YELLOW, save_figures
from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.report.amounts import scaled
from analysis.mismatch.report.contents import Report, Window
from analysis.recordings.trial import PHASE_NAMES
from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]

RECORDED, BASELINE, IMPROVED, WINDOW = "#666666", VERMILLION, BLUE, YELLOW
_GRID = 160
_WIDEST_S = 0.4
_SETTLING_S = 0.03
_FEWEST_SAMPLES = 30
_FEWEST_POINTS = 4
_OVER_DEPTH = ("approach", "retract")
_REST = 0.02
_AIR_SHOWN = 0.25
_SHALLOW_MM = 0.1


def draw_figures(out: Path, diagnosis: Diagnosis, report: Report) -> dict[str, Path]:
    """Draw the figures into ``out`` as PNG (the PDF beside); return name -> PNG."""
    drawers: dict[str, tuple[tuple[float, float], Callable[[Any], None]]] = {
        "trial": ((7.4, 4.8), lambda figure: _trial(figure, diagnosis, report)),
        "residual": ((7.4, 4.2), lambda figure: _residual(figure, diagnosis, report)),
    }
    if any(w.signal == "position" for w in report.mismatch):
        drawers["position"] = ((7.4, 2.8), lambda figure: _position(figure, diagnosis, report))
    return save_figures(out, drawers)


def _representative(fit: StudyFit, window: Window | None) -> int:
    """Return the trial to be shown: the one with the clearest residual where the largest window lies."""
    best, most = 0, -1.0
    for j, trial in enumerate(fit.trials):
        if not trial.fitted.any():
            continue
        inside = trial.fitted.copy()
        if window is not None and window.signal == "force":
            inside &= trial.in_phase(window.phase)
        r = fit.residual_mn(j)
        size = float(trial.counts[inside] @ r[inside] ** 2) if inside.any() else 0.0
        if size > most:
            best, most = j, size
    return best


def _trial(figure: Any, diagnosis: Diagnosis, report: Report) -> None:
    """One trial: recorded force and both simulations; below, what each leaves; right, the window."""
    base, improved = diagnosis.baseline.fit, diagnosis.improved.fit
    force = [w for w in report.mismatch if w.signal == "force"]
    j = _representative(base, force[0] if force else None)
    trial = base.trials[j]
    before, after = base.residual_mn(j), improved.residual_mn(j)
    panels = figure.subplots(2, 2, height_ratios=(2, 1), width_ratios=(3, 2), sharex="col")
    shown = trial.fitted
    focus = _own_window(trial, force[0], before - after) if force else None
    different = bool(diagnosis.findings)
    factor, unit = scaled(report.peak_force_mn, "mN")
    for column, span in enumerate((None, focus or _motion_of(trial))):
        above, below = panels[0, column], panels[1, column]
        part = shown if span is None else shown & (trial.time_s >= span[0]) & (trial.time_s <= span[1])
        t = trial.time_s[part]
        recorded = {"ms": 2.2, "color": RECORDED, "alpha": 0.5, "label": "recorded", "rasterized": True}
        above.plot(t, factor * trial.force_mn[part], ".", **recorded)
        above.plot(
            t, factor * (trial.force_mn - before)[part], "--", lw=1.3, color=BASELINE, label="simulation"
        )
        if different:
            label = "with what was left out"
            above.plot(t, factor * (trial.force_mn - after)[part], "-", lw=1.2, color=IMPROVED, label=label)
        width = _smoothing(trial, part)
        below.plot(t, factor * _smooth(before[part], width), color=BASELINE, lw=1.0)
        if different:
            below.plot(t, factor * _smooth(after[part], width), color=IMPROVED, lw=1.0)
        below.axhline(0.0, color="black", lw=0.5)
        if focus:
            for axes in (above, below):
                if span is None:
                    axes.axvspan(*focus, color=WINDOW, alpha=0.35, lw=0)
        below.set_xlabel("time since the trial's first sample (s)")
        if span is not None:
            below.locator_params(axis="x", nbins=4)  # a short stretch far from zero has long labels
    panels[0, 0].set_ylabel(f"force ({unit})")
    panels[1, 0].set_ylabel(f"recorded − simulated\n({unit})")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), markerscale=3)
    panels[0, 0].set_title(Path(trial.label).stem, fontsize=9, loc="left")
    panels[0, 1].set_title("the marked stretch, enlarged" if focus else "the ramp", fontsize=9, loc="left")


def _own_window(trial: CellTrial, window: Window, effect: FloatArray) -> tuple[float, float] | None:
    """Return the stretch of this trial in which the window's effect lies, with a margin."""
    inside = trial.in_phase(window.phase) & trial.fitted
    if not inside.any():
        return None
    t = trial.time_s[inside]
    size = np.abs(effect[inside])
    if size.max() > 0:
        clear = t[size > 0.1 * size.max()]
        at = float(t[int(np.argmax(size))])
        # what lasts for seconds is shown about its largest moment, or nothing would be enlarged
        t = clear[np.abs(clear - at) <= _WIDEST_S]
    margin = max(0.6 * float(t[-1] - t[0]), 0.01)
    first, last = float(trial.time_s[0]), float(trial.time_s[-1])
    return max(float(t[0]) - margin, first), min(float(t[-1]) + margin, last)


def _motion_of(trial: CellTrial) -> tuple[float, float]:
    moving = trial.in_phase("ramp", "sweep")
    moving = moving if moving.any() else trial.fitted
    t = trial.time_s[moving]
    margin = 0.5 * float(t[-1] - t[0])
    return float(t[0]) - margin, float(t[-1]) + margin


def _smoothing(trial: CellTrial, part: NDArray[np.bool_]) -> int:
    return 1 if part.sum() < 400 else int(part.sum() // 400) | 1


def _smooth(values: FloatArray, width: int) -> FloatArray:
    if width < 3 or len(values) < width:
        return values
    from scipy.ndimage import uniform_filter1d

    return np.asarray(uniform_filter1d(values, width, mode="nearest"))


def _residual(figure: Any, diagnosis: Diagnosis, report: Report) -> None:
    """Mean residual over trials of each condition, phase by phase, before (above) and after (below)."""
    trials = diagnosis.baseline.fit.trials
    base = diagnosis.baseline.fit
    left = [base.residual_mn(j) for j in range(len(trials))]
    phases = [p for p in PHASE_NAMES if _shows(trials, left, [s.z0_mm for s in base.states], p)]
    factor, unit = scaled(report.peak_force_mn, "mN")
    fits = [("simulation", base)]
    if diagnosis.findings:
        fits.append(("with what was left out", diagnosis.improved.fit))
    panels = figure.subplots(len(fits), len(phases), sharey=True, sharex="col", squeeze=False)
    conditions = _few_conditions(trials)
    drawn: dict[str, Any] = {}
    for row, (name, fit) in enumerate(fits):
        residuals = [fit.residual_mn(j) for j in range(len(trials))]
        for column, phase in enumerate(phases):
            axes = panels[row, column]
            along, name_of_measure = _measure(phase, trials[0].study_depth_mm)
            for k, (label, members) in enumerate(conditions):
                found = phase_curve(trials, residuals, [s.z0_mm for s in fit.states], phase, members)
                if found is not None:
                    measure, mean_mn = found
                    colour = COLOURS[k % len(COLOURS)]
                    (line,) = axes.plot(along * measure, factor * mean_mn, lw=0.9, color=colour)
                    drawn.setdefault(label, line)
            axes.axhline(0.0, color="black", lw=0.5)
            if phase in ("hold", "dwell", "clear"):
                axes.set_xscale("log")
            if row == 0:
                if phase == "retract":
                    axes.invert_xaxis()
                marked = any(w.signal == "force" and w.phase == phase for w in report.mismatch)
                axes.set_title(phase, fontsize=9)
                if marked:
                    axes.set_facecolor("#FFFBE0")
            if row == len(fits) - 1:
                axes.set_xlabel(name_of_measure)
        panels[row, 0].set_ylabel(f"{name}\nmean residual ({unit})")
    if len(drawn) > 1:
        shown = {label: drawn[label] for label, _ in conditions if label in drawn}
        figure.legend(
            shown.values(), shown.keys(), loc="outside lower center", ncols=min(4, len(shown)), fontsize=7
        )


def _shows(
    trials: Sequence[CellTrial], residuals: Sequence[FloatArray], z0s_mm: Sequence[float], phase: str
) -> bool:
    """Whether a phase has a curve to draw, and no lonely points."""
    curve = phase_curve(trials, residuals, z0s_mm, phase, range(len(trials)))
    return curve is not None and len(curve[0]) >= _FEWEST_POINTS


def _measure(phase: str, study_depth_mm: float) -> tuple[float, str]:
    """Return a factor and the name of what a phase is laid out over."""
    if phase in _OVER_DEPTH:
        return (1e3, "depth (um)") if study_depth_mm < _SHALLOW_MM else (1.0, "depth (mm)")
    return 1.0, "share of it" if phase in ("ramp", "sweep") else "since start (s)"


def _few_conditions(trials: Sequence[CellTrial]) -> list[tuple[str, list[int]]]:
    groups: dict[str, list[int]] = {}
    for j, t in enumerate(trials):
        groups.setdefault(t.condition, []).append(j)
    named = [
        (label.replace("ramp_hold_retract ", "").replace("_", " "), members)
        for label, members in groups.items()
    ]
    named.sort(key=lambda item: [float(n) for n in re.findall(r"[\d.]+", item[0])])
    return (
        named
        if len(named) <= 7
        else [named[i] for i in np.linspace(0, len(named) - 1, 7).round().astype(int)]
    )


def phase_curve(
    trials: Sequence[CellTrial],
    residuals: Sequence[FloatArray],
    z0s_mm: Sequence[float],
    phase: str,
    members: Sequence[int],
) -> tuple[FloatArray, FloatArray] | None:
    """Return a measure common to a phase (160,) and the members' mean residual over it (mN), or None."""
    measured = []
    for j in members:
        t = trials[j]
        inside = t.in_phase(phase) & t.fitted
        if inside.sum() < 4:
            continue
        s = t.time_s[inside]
        half = 0.5 / t.sample_rate_hz
        if phase in _OVER_DEPTH:
            measure = t.position_mm[inside] - z0s_mm[j]
            if np.ptp(measure) < _REST * t.study_depth_mm:
                continue
        elif phase in ("ramp", "sweep"):
            measure = (s - s[0]) / (s[-1] - s[0])
        else:
            measure = s - s[0] + half
        measured.append((measure, residuals[j][inside], t.counts[inside]))
    if not measured:
        return None
    low, high = min(float(m.min()) for m, _, _ in measured), max(float(m.max()) for m, _, _ in measured)
    if phase in _OVER_DEPTH:
        low = max(low, -_AIR_SHOWN * trials[0].study_depth_mm)
    if high <= low:
        return None
    log = phase in ("hold", "dwell", "clear") and low > 0
    edges = np.geomspace(low, high, _GRID + 1) if log else np.linspace(low, high, _GRID + 1)
    total, weight = np.zeros(_GRID), np.zeros(_GRID)
    for measure, r, counts in measured:
        at = np.searchsorted(edges, measure, side="right") - 1
        at[measure == high] = _GRID - 1
        ok = (at >= 0) & (at < _GRID)
        total += np.bincount(at[ok], weights=(r * counts)[ok], minlength=_GRID)
        weight += np.bincount(at[ok], weights=counts[ok], minlength=_GRID)
    some = weight > 0
    return (0.5 * (edges[1:] + edges[:-1]))[some], total[some] / weight[some]


def _position(figure: Any, diagnosis: Diagnosis, report: Report) -> None:
    """Mean of recorded position less the nominal servo's: about the changes of speed, a sweep whole."""
    used = [t for t in diagnosis.intake.trials if t.has_command]
    phases = list(dict.fromkeys(w.phase for w in report.mismatch if w.signal == "position"))[:4]
    panels = figure.subplots(1, len(phases), sharey=True, squeeze=False)
    for axes, phase in zip(panels[0], phases, strict=True):
        shown = [(t, np.flatnonzero(t.in_phase(phase))) for t in used]
        shown = [(t, inside) for t, inside in shown if inside.size >= 4]
        if not shown:
            continue
        span_s = _position_span_s(phase, shown)
        # from a little before the phase: what lags behind shows where the motion changes
        grid = np.linspace(-span_s / 15.0, span_s, _GRID)
        curves = []
        for t, inside in shown:
            first, last = t.time_s[inside[0]], t.time_s[inside[-1]]
            near = (t.time_s > first + grid[0]) & (t.time_s < min(first + span_s, last + span_s / 3.0))
            offset = float(np.median(t.servo_residual_mm))
            curves.append(np.interp(grid, t.time_s[near] - first, t.servo_residual_mm[near] - offset))
        factor, unit = (1e3, "ms") if span_s < 1.0 else (1.0, "s")
        axes.plot(factor * grid, 1e3 * np.mean(curves, axis=0), color=BASELINE, lw=1.1)
        axes.axhline(0.0, color="black", lw=0.5)
        axes.set_title(phase, fontsize=9)
        axes.set_xlabel(f"since its start ({unit})")
    panels[0, 0].set_ylabel("recorded − nominal servo\n(um)")


def _position_span_s(phase: str, shown: Sequence[tuple[CellTrial, NDArray[np.int64]]]) -> float:
    """Return how much of a phase is drawn (s): what a servo takes to settle, or what a few samples show."""
    longest = max(float(t.time_s[inside[-1]] - t.time_s[inside[0]]) for t, inside in shown)
    slowest_hz = min(t.sample_rate_hz for t, _ in shown)
    return longest if phase == "sweep" else min(max(_SETTLING_S, _FEWEST_SAMPLES / slowest_hz), longest)
