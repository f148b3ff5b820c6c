"""The fits on the screen: what an experimenter looks for before opening the page."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from analysis.relaxation.findings import Findings
from analysis.relaxation.numbers import concise
from analysis.relaxation.result import NAMES, TrialFit

_MOST_ROWS = 40
_MOST_LINES = 200
_HEADS = {
    "A0_mn": "A0 (mN)",
    "A1_over_A0": "A1/A0",
    "A2_over_A0": "A2/A0",
    "t1_s": "t1 (s)",
    "t2_s": "t2 (s)",
}


def show_fits(found: Findings) -> None:
    """Print the table of all trials, their means, and why trials were not fitted, on stderr."""
    console = Console(stderr=True)
    table = Table(title=_title(found), title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("trial", overflow="fold", min_width=8)
    of_ramp = any(row.exponent is not None for row in found.rows)
    for name in (*_HEADS.values(), *(["p of d^p"] if of_ramp else []), "rms %"):
        table.add_column(name, justify="right", overflow="fold")
    fitted = [row for row in found.rows if row.fitted]
    for row in fitted[:_MOST_ROWS]:
        table.add_row(*map(Text, _cells(row, of_ramp=of_ramp)))
    if len(fitted) > 1 and found.study.groups:
        columns = found.study.groups[-1].columns
        means = [columns.get(name) for name in NAMES]
        cells = [concise(one.mean, one.sd) if one else "" for one in means]
        table.add_section()
        table.add_row(*map(Text, ["mean(sd)", *cells, *([""] if of_ramp else []), ""]))
    if fitted:
        console.print(table)
    if len(fitted) > _MOST_ROWS:
        console.print(Text(f"{len(fitted) - _MOST_ROWS} more trials are in fits.csv"))
    for row in found.rows[:_MOST_LINES]:
        if not row.fitted:
            console.print(Text(f"{row.file}: not fitted: {row.failure}"), soft_wrap=True)
        if row.creep:
            console.print(Text(f"{row.file}: creep: {row.creep}"), soft_wrap=True)
        raised = [check.name.replace("_", " ") for check in row.checks if check.raised]
        if raised and not row.discarded:
            console.print(Text(f"{row.file}: flags: {', '.join(raised)}"), soft_wrap=True)
        for reason in dict.fromkeys(row.untold.values()):
            names = ", ".join(_HEADS[name] for name in row.untold if row.untold[name] == reason)
            console.print(Text(f"{row.file}: not told: {names}: {reason}"), soft_wrap=True)


def _title(found: Findings) -> str:
    n_bad = sum(not row.fitted for row in found.rows)
    return (
        f"{len(found.rows) - n_bad} of {len(found.rows)} trials fitted, {found.study.n_used} in the means; "
        "2.28(4) is 2.28 ± 0.04"
    )


def _cells(row: TrialFit, *, of_ramp: bool) -> list[str]:
    told = [row.estimates.get(name) for name in NAMES]
    cells = ["" if one is None else concise(one.value, one.se) for one in told]
    if of_ramp:
        cells.append("" if row.exponent is None else concise(row.exponent.value, row.exponent.se))
    percent = row.rms_percent
    name = row.file.removesuffix(".h5") + (" (discarded)" if row.discarded else "")
    return [name, *cells, "" if percent is None else f"{percent:.2g}"]
