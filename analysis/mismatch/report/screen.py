"""A diagnosis on the screen: its verdict, what was left out and where it showed, before the page is opened."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from analysis.mismatch.model.words import spoken
from analysis.mismatch.report import amounts
from analysis.mismatch.report.contents import Report, Window
from analysis.mismatch.report.page import VERDICTS, windows_of

_MOST_WINDOWS = 5
_MOST_LEFT_OUT = 20
_COLOURS = {"no_mismatch": "green", "named": "cyan", "one_of": "yellow", "unknown": "red"}


def show_report(report: Report) -> None:
    """Print verdict, summary, the effects found, where recordings differ, and the trials left out, on stderr."""
    console = Console(stderr=True, highlight=False)
    colour = _COLOURS[report.verdict]
    console.print(Text(f"{report.verdict}: {VERDICTS[report.verdict]}", style=f"bold {colour}"))
    console.print(Text(report.summary))
    if report.mechanisms:
        console.print(_effects(report))
    for after_naming, title in ((True, "what is left, and where"), (False, "what differs, and where")):
        windows = windows_of(report.mismatch, after_naming=after_naming)
        if windows:
            console.print(_windows(title, windows))
    for line in report.left_out[:_MOST_LEFT_OUT]:
        console.print(Text(f"left out: {line}", style="yellow"), soft_wrap=True)
    if len(report.left_out) > _MOST_LEFT_OUT:
        console.print(Text(f"{len(report.left_out) - _MOST_LEFT_OUT} more left out are in report.json"))


def _effects(report: Report) -> Table:
    before, after, noise = amounts.errors(report.heldout)
    title = (
        f"{report.n_trials} trial{'s' if report.n_trials > 1 else ''}, error {before} before, {after} after, "
        f"{noise} noise (rms)"
    )
    table = _table(title, "left out", "size", "share of it", "p", "probability", "or")
    for m in report.mechanisms:
        sizes = [f"{amounts.symbol(name)} {amounts.with_error(q)}" for name, q in m.parameters.items()]
        rivals = [f"{spoken(a)} ({amounts.percent(m.alternative_probabilities[a])})" for a in m.alternatives]
        cells = (
            spoken(m.name),
            "\n".join(sizes),
            amounts.percent(m.share_of_mismatch),
            amounts.chance(m.p_value),
            amounts.percent(m.probability),
            "\n".join(rivals),
        )
        table.add_row(*map(Text, cells))
    return table


def _windows(title: str, windows: Sequence[Window]) -> Table:
    most = f", the largest {_MOST_WINDOWS}" if len(windows) > _MOST_WINDOWS else ""
    table = _table(title + most, "signal", "phase", "time (s)", "mean", "rms", "share", "p")
    for window in windows[:_MOST_WINDOWS]:
        table.add_row(*map(Text, _window_cells(window)))
    return table


def _window_cells(window: Window) -> tuple[str, ...]:
    in_um = window.mean_residual_um
    mean = f"{in_um:+.3g} um" if in_um is not None else amounts.force(window.mean_told_mn or 0.0, signed=True)
    return (
        window.signal,
        window.phase,
        f"{window.start_s:.3f} to {window.stop_s:.3f}",
        mean,
        "" if window.rms_mn is None else amounts.force(window.rms_mn),
        amounts.percent(window.share_of_mismatch),
        amounts.chance(window.p_value),
    )


def _table(title: str, *heads: str) -> Table:
    table = Table(title=title, title_justify="left", title_style="", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for k, head in enumerate(heads):
        table.add_column(head, overflow="fold", justify="left" if k < 2 or head == "or" else "right")
    return table
