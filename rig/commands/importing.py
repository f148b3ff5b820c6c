"""`indenter import`: reads recordings of other programs, and shows what it found in each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from analysis.recordings.importers.findings import in_short
from analysis.recordings.importers.instructions import Instructions
from analysis.recordings.importing import Imported, import_recordings
from analysis.recordings.trial import Kind

_SHOWN_WHOLE = 3  # trials; of more, one line each


def import_and_show(
    paths: Sequence[Path], out: Path, *, kind: Kind | None, said: Instructions, plot: bool
) -> list[Path]:
    """Import, print the trial files on stdout and what was found on stderr; return the files made."""
    made, refused = import_recordings(paths, out, kind, said)
    console = Console(stderr=True, soft_wrap=False)
    if len(made) > _SHOWN_WHOLE:
        console.print(_overview(made))
    for one in made if len(made) <= _SHOWN_WHOLE else ():
        console.print(_whole(one))
    for one in made:
        for warning in one.findings.warnings:
            console.print(Text(f"warning: {one.path.name}: {warning}", style="yellow"), soft_wrap=True)
    for bad in refused:
        line = f"indenter: {' '.join(bad.reason.split())}"
        console.print(Text(line), soft_wrap=True)
    if plot:
        from analysis.recordings.picture import draw_trial

        for one in made:
            console.print(Text(f"picture: {draw_trial(one.trial, out, one.path.stem)}"), soft_wrap=True)
    for one in made:
        print(one.path)
    return [one.path for one in made]


def _whole(one: Imported) -> Table:
    table = Table(title=Text(f"{one.source.name} → {one.path.name}"), title_justify="left", show_header=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for what, words in one.findings.rows:
        table.add_row(Text(what), Text(words))
    for line in one.trial.log[1:]:
        if not line.startswith(tuple(f"{what}: " for what, _ in one.findings.rows)) and "WARNING" not in line:
            table.add_row(Text("noted"), Text(line))
    return table


def _overview(made: Sequence[Imported]) -> Table:
    table = Table(title=f"{len(made)} trials", title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("trial", overflow="fold")
    for name in ("rate (Hz)", "depth (mm)", "ramp (s)", "hold (s)", "peak (mN)", "warnings"):
        table.add_column(name, justify="right")
    for one in made:
        cells = [one.path.stem, *in_short(one.trial), f"{len(one.findings.warnings) or ''}"]
        table.add_row(*map(Text, cells))
    return table
