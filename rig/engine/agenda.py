"""What is still to be recorded in a run, in order; a trial may be put in again while it runs."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from pathlib import Path

from rig.engine.attempts import next_attempt, planned_name
from rig.engine.tasks import Task
from rig.protocols.steps import PlannedTrial


class Agenda:
    """The tasks of one run; `out` is the folder of their files."""

    def __init__(self, tasks: Sequence[Task], out: Path) -> None:
        self.out = out
        self.n_begun = 0
        self._ahead = deque(tasks)
        self._stems = {task.path.stem for task in tasks}

    @property
    def n_tasks(self) -> int:
        """Tasks in all, those that are over included."""
        return self.n_begun + len(self._ahead)

    def next(self) -> Task | None:
        """Return the task that comes next; None at the end."""
        if not self._ahead:
            return None
        self.n_begun += 1
        return self._ahead.popleft()

    def repeat(self, trial: PlannedTrial) -> Task:
        """Put a planned trial in again, next; return its task."""
        stems = {path.stem for path in self.out.glob("*.h5")} | self._stems
        task = next_attempt(trial, self.out, [stem for stem in stems if planned_name(stem) == trial.name])
        self._stems.add(task.path.stem)
        self._ahead.appendleft(task)
        return task
