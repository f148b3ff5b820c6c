"""Follow a run from another terminal: what it does, how much time is left, position and force as they are."""

from __future__ import annotations

import time

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from analysis.recordings.trial import FloatArray
from rig.engine.following import SILENT_S, Follower, follow_newest
from rig.engine.progress import Snapshot, clock_words
from rig.engine.states import ENDED
from rig.errors import RigError

_EVERY_S = 0.1
_TRACE_S = 8.0
"""How far back the small trace of the force reaches."""

_BARS = " ▁▂▃▄▅▆▇█"
_WIDTH = 60


def watch() -> None:
    """Follow the newest run of this user until it ends; Ctrl-C stops the watching, not the run.

    Raises RigError where no run is in progress.
    """
    follower = follow_newest()
    if follower is None:
        raise RigError("no run is in progress: start one with `indenter run`, then watch it")
    with follower:
        last = _follow(follower)
    if last is None:
        raise RigError(
            "the run is no longer heard of: where its program died, `indenter rescue` saves its trial"
        )
    Console().print(f"{last.title}: {last.state} {last.message}".rstrip(), highlight=False)


def _follow(follower: Follower) -> Snapshot | None:
    """Show the run until it ends; return its last snapshot, None where it fell silent."""
    last = follower.snapshot()
    heard = time.monotonic()
    with Live(refresh_per_second=10, transient=True) as live:
        while last is not None and last.state not in ENDED:
            live.update(screen(last, follower))
            snapshot = follower.snapshot(_EVERY_S)
            if snapshot is not None:
                last, heard = snapshot, time.monotonic()
            elif time.monotonic() - heard > SILENT_S:
                return None
    return last


def screen(snapshot: Snapshot, follower: Follower) -> RenderableType:
    """Return what is shown of one moment."""
    ring = follower.ring
    _, volts = ring.latest(round(_TRACE_S * ring.sample_rate_hz))
    c = ring.calibration
    about = Table.grid(padding=(0, 2))
    about.add_row("run", f"{snapshot.title}, trial {snapshot.trial_number} of {snapshot.n_trials}")
    about.add_row("trial", snapshot.trial)
    about.add_row("state", Text(f"{snapshot.state} {snapshot.message}".rstrip(), style="bold"))
    about.add_row("time", f"{clock_words(snapshot.done_s)} done, {clock_words(snapshot.left_s)} left")
    parts: list[RenderableType] = [about]
    total = max(snapshot.done_s + snapshot.left_s, 1e-9)
    parts.append(ProgressBar(total=total, completed=snapshot.done_s, width=_WIDTH))
    if volts.shape[1]:
        position_mm = (volts[0] - c.position_zero_v) / c.volts_per_mm
        force_mn = (volts[1] - c.force_zero_v) / c.volts_per_mn
        recent = slice(-max(1, round(0.02 * ring.sample_rate_hz)), None)
        about.add_row("position", f"{np.mean(position_mm[recent]):9.4f} mm")
        about.add_row("force", f"{np.mean(force_mn[recent]):9.2f} mN")
        about.add_row("", Text(trace(force_mn), style="green"))
    return Group(*parts)


def trace(values: FloatArray, width: int = _WIDTH) -> str:
    """Return a line of `width` bars, the highest of each stretch of the values, (n,)."""
    stretches = [part for part in np.array_split(values, width) if len(part)]
    peaks = np.array([float(np.max(part)) for part in stretches])
    low, high = float(np.min(peaks)), float(np.max(peaks))
    if high - low < 1e-9:
        return _BARS[1] * len(peaks)
    steps = np.round((peaks - low) / (high - low) * (len(_BARS) - 2)).astype(int) + 1
    return "".join(_BARS[step] for step in steps)
