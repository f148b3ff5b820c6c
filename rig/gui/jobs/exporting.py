"""Trials for other programs: fits and samples as CSV, the plot as a figure on paper."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from analysis.errors import BadInputError
from analysis.figures import COLOURS, save_figures
from analysis.recordings.importing import import_recordings
from analysis.recordings.reading import read_trial
from analysis.recordings.writing import replacing
from analysis.relaxation.batch import fit_files
from analysis.relaxation.result import Model
from analysis.relaxation.tables import write_csv
from rig.gui.jobs.traces import Axes, read_traces

_INCHES = (7.0, 4.4)
_BINS = 1500
_MOST_NAMED = 8


def export_samples(paths: Sequence[str], out: Path) -> tuple[str, ...]:
    """Write each trial's samples as CSV in the columns that `indenter import` reads; return the files."""
    written = []
    for path in map(Path, paths):
        trial = read_trial(path)
        columns = {"time_s": trial.time_s, "position_mm": trial.position_mm, "force_mn": trial.force_mn}
        if trial.command_mm is not None:
            columns["command_mm"] = trial.command_mm
        target = out / f"{path.stem}.csv"
        table = np.column_stack(list(columns.values()))
        with _written_to(target), replacing(target, finished=False) as part:
            np.savetxt(part, table, "%.9g", delimiter=",", header=",".join(columns), comments="")
        written.append(str(target))
    return tuple(written)


def export_fits(paths: Sequence[str], model: Model, out: Path) -> str:
    """Fit the trials and write fits.csv into a folder; return the file."""
    target = out / "fits.csv"
    rows = fit_files([Path(path) for path in paths], model)
    with _written_to(target), replacing(target, finished=False) as part:
        write_csv(part, rows)
    return str(target)


def export_figure(paths: Sequence[str], labels: Sequence[str], axes: Axes, out: Path, name: str) -> str:
    """Draw the trials as they are overlaid, as PNG and PDF; return the PNG."""
    traces = read_traces(paths, axes, _BINS)

    def draw(figure: Any) -> None:
        (x_name, x_unit), (y_name, y_unit) = axes.labels
        panel = figure.subplots()
        groups = list(dict.fromkeys(labels))
        for group in groups:
            colour = COLOURS[groups.index(group) % len(COLOURS)]
            members = [trace for trace, label in zip(traces, labels, strict=True) if label == group]
            for i, trace in enumerate(members):
                panel.plot(trace.x, trace.y, lw=0.7, color=colour, label=None if i else group)
        panel.set_xlabel(f"{x_name} ({x_unit})")
        panel.set_ylabel(f"{y_name} ({y_unit})" if y_unit else f"{y_name}, {axes.scale}")
        if 1 < len(groups) <= _MOST_NAMED:
            panel.legend()

    with _written_to(out / name):
        return str(save_figures(out, {name: (_INCHES, draw)})[name])


def bring_in(file: Path, out: Path) -> tuple[str, ...]:
    """Import another program's recording into a folder; one that was imported there before is kept as it is."""
    kept = out / f"{file.stem}.h5"
    if kept.exists():
        _check_same(file, kept)
        return (str(kept),)
    made, refused = import_recordings([file], out)
    if refused:
        raise BadInputError(refused[0].reason)
    return tuple(str(one.path) for one in made)


def _check_same(file: Path, kept: Path) -> None:
    """Refuse to show a recording in the place of another of the same name."""
    with TemporaryDirectory() as fresh:
        made, refused = import_recordings([file], Path(fresh))
    if refused:
        raise BadInputError(refused[0].reason)
    before = read_trial(kept)
    if not any(np.array_equal(one.trial.force_v, before.force_v) for one in made):
        raise BadInputError(f"{file}: {kept} is another recording of this name: rename one of them")


@contextmanager
def _written_to(out: Path) -> Iterator[None]:
    """Say in one line what keeps a file from being written."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        yield
    except OSError as error:
        raise BadInputError(f"{out}: can't be written ({error.strerror}): choose another folder") from error
