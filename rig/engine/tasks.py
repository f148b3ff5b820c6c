"""What a run is given to do, and what became of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rig.protocols.steps import PlannedTrial

Outcome = Literal["complete", "cut short", "failed", "skipped", "discarded"]


@dataclass(frozen=True, slots=True)
class Task:
    """A planned trial and the file it goes to."""

    trial: PlannedTrial
    path: Path


@dataclass(frozen=True, slots=True)
class Recorded:
    """A trial that was recorded to its end; `mass_g` is what hung from the arm, where a weight did."""

    task: Task
    mass_g: float | None


@dataclass(frozen=True, slots=True)
class Ended:
    """What became of one trial: its name in the plan, its file's name, and why, where it is not complete.

    `file` is empty where the trial ended before one was begun.
    """

    trial: str
    file: str
    outcome: Outcome
    reason: str = ""

    @classmethod
    def of(cls, task: Task, outcome: Outcome, reason: str) -> Ended:
        """Return what became of a task, with its file where there is one."""
        return cls(task.trial.name, task.path.name if task.path.exists() else "", outcome, reason)
