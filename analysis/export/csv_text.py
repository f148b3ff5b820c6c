"""Trials as text, a file each, in the columns that `indenter import` reads back."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from analysis.export.exporting import free
from analysis.recordings.trial import Trial


def write_csv_files(trials: Mapping[str, Trial], out: Path) -> list[Path]:
    """Write NAME.csv a trial (time_s, position_mm, force_mn, command_mm, phase), and fits/fits.csv.

    An unevenly sampled import is written as it was taken; then it has no command.
    """
    paths = [free(out / f"{name}.csv") for name in trials]
    for path, trial in zip(paths, trials.values(), strict=True):
        _write(path, trial)
    from analysis.relaxation.batch import fit_to_tables

    fits = out / "fits"
    fit_to_tables([Path(trial.path) for trial in trials.values()], model="ramp", out=fits, jobs=1)
    return [*paths, fits / "fits.csv"]


def _write(path: Path, trial: Trial) -> None:
    native, command_mm = trial.native, trial.command_mm
    if native is not None:
        columns = {"time_s": native.time_s, "position_mm": native.position_mm, "force_mn": native.force_mn}
    else:
        columns = {"time_s": trial.time_s, "position_mm": trial.position_mm, "force_mn": trial.force_mn}
        if command_mm is not None:
            columns["command_mm"] = command_mm
    phases = phase_names(trial, columns["time_s"])
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join([*columns, "phase"]) + "\n")
        table = np.column_stack(list(columns.values()))
        for row, phase in zip(table.tolist(), phases, strict=True):
            file.write(",".join([*(f"{value:.9g}" for value in row), phase]) + "\n")


def phase_names(trial: Trial, time_s: np.ndarray[tuple[int], np.dtype[np.float64]]) -> list[str]:
    """Return the phase (N,) that each instant (N,) lies in, "" for none."""
    names = np.full(len(time_s), "", dtype=object)
    for phase in trial.phases:
        start_s, stop_s = phase.start / trial.sample_rate_hz, phase.stop / trial.sample_rate_hz
        names[(time_s >= start_s - 1e-9) & (time_s < stop_s - 1e-9)] = phase.name
    return [str(name) for name in names]
