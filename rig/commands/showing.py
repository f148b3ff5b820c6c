"""What a person at the terminal sees of a run: what it does, how far it is, how much time is left."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn

from rig.engine.progress import Snapshot, clock_words
from rig.engine.states import State
from rig.hardware.lever import Chunk


class TerminalProgress:
    """An observer that prints a line for every trial saved and, on a terminal, keeps a bar below.

    While a hand is needed the bar is put away, so that the question stands alone.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=None),
            TextColumn("{task.fields[left]} left"),
            console=console,
            transient=True,
        )
        self._task = self._bar.add_task("", total=1.0, left="")
        self._saved = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def show(self, snapshot: Snapshot) -> None:
        """Show one moment of the run."""
        if snapshot.state is State.SAVED and snapshot.trial_number != self._saved:
            self._saved = snapshot.trial_number
            self._console.print(_saved(snapshot), highlight=False, soft_wrap=True)
        if not self._console.is_terminal:
            return
        if snapshot.state in {State.PREPARING, State.PAUSED}:
            self._bar.stop()
            return
        self._bar.update(
            self._task,
            description=_doing(snapshot),
            completed=snapshot.done_s,
            total=max(snapshot.done_s + snapshot.left_s, 1e-9),
            left=clock_words(snapshot.left_s),
        )
        self._bar.start()

    def follow(self, chunk: Chunk) -> None:
        """See samples; the terminal shows none of them."""

    def mark(self, name: str, sample: int, now: int) -> None:
        """Hear of a phase; the state says as much."""


def _doing(snapshot: Snapshot) -> str:
    doing = snapshot.message if snapshot.state is State.RESTING else str(snapshot.state)
    return f"{snapshot.trial_number}/{snapshot.n_trials} {snapshot.trial}: {doing}"


def _saved(snapshot: Snapshot) -> str:
    found = f": {snapshot.message}" if snapshot.message else ""
    left = f", {clock_words(snapshot.left_s)} left" if snapshot.left_s > 0 else ""
    return f"  {snapshot.trial_number}/{snapshot.n_trials} {snapshot.trial}{found}{left}"
