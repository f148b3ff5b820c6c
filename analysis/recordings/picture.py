"""A picture of a trial with its phases: what an import made of a recording, for the eye."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from analysis.figures import COLOURS, save_figures
from analysis.recordings.trial import Trial

_SHADES = {
    "approach": "#eeeeee",
    "dwell": "#dddddd",
    "ramp": "#fbe3d2",
    "hold": "#d9ecf7",
    "retract": "#e6f2ec",
}
_MOST_POINTS = 4000


def draw_trial(trial: Trial, out: Path, name: str) -> Path:
    """Draw position and force over time into ``out``, phases shaded, the loading enlarged; return the PNG."""
    out.mkdir(parents=True, exist_ok=True)
    return save_figures(out, {name: ((8.0, 5.0), lambda figure: _draw(figure, trial))})[name]


def _draw(figure: Any, trial: Trial) -> None:
    ramp, hold = trial.phase("ramp"), trial.phase("hold")
    panels = [(0, trial.n_samples)]
    if ramp is not None and hold is not None and ramp.stop - ramp.start < trial.n_samples / 4:
        around = 2 * (ramp.stop - ramp.start)
        panels.append((max(0, ramp.start - around // 2), min(trial.n_samples, ramp.stop + around)))
    axes = figure.subplots(2, len(panels), sharex="col", squeeze=False)
    names = {}
    for column, (first, last) in enumerate(panels):
        used = slice(first, last, max(1, (last - first) // _MOST_POINTS))
        time_s = trial.time_s[used]
        rows = (("position (mm)", trial.position_mm), ("force (mN)", trial.force_mn))
        for row, (label, values) in enumerate(rows):
            at = axes[row, column]
            at.plot(time_s, values[used], lw=0.9, color=COLOURS[row])
            if column == 0:
                at.set_ylabel(label)
            for phase in trial.phases:
                start_s, stop_s = phase.start / trial.sample_rate_hz, phase.stop / trial.sample_rate_hz
                shade = _SHADES.get(phase.name, "#f5f5f5")
                names[phase.name] = at.axvspan(start_s, stop_s, color=shade, lw=0)
            at.set_xlim(float(time_s[0]), float(time_s[-1]) + 1e-12)
        axes[0, column].set_title("the whole recording" if column == 0 else "the loading", fontsize=9)
        axes[1, column].set_xlabel("time (s)")
    if names:
        figure.legend(names.values(), names.keys(), loc="outside lower center", ncols=len(names))
    figure.suptitle(Path(trial.path).name or trial.trial_id, fontsize=10)
