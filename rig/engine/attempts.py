"""A trial recorded again: under which name, and at a site that was not pressed before."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from rig.engine.tasks import Task
from rig.protocols.steps import Ask, PlannedTrial, Preparation

_ATTEMPT = re.compile(r"(?P<name>.+?)(?:_again(?P<number>\d+))?$")


def planned_name(stem: str) -> str:
    """Return the name in the plan of the trial whose file has this stem."""
    match = _ATTEMPT.match(stem)
    return stem if match is None else match["name"]


def attempt_number(stem: str) -> int:
    """Return which attempt a file of this stem is: 1 for the first."""
    match = _ATTEMPT.match(stem)
    return int(match["number"] or 1) if match is not None else 1


def next_attempt(trial: PlannedTrial, out: Path, taken: Iterable[str]) -> Task:
    """Return the task that records a planned trial once more; `taken` are the stems of its earlier files."""
    number = 1 + max((attempt_number(stem) for stem in taken), default=0)
    if number == 1:
        return Task(trial, out / f"{trial.name}.h5")
    return Task(_at_a_new_site(trial, number), out / f"{trial.name}_again{number}.h5")


def _at_a_new_site(trial: PlannedTrial, number: int) -> PlannedTrial:
    site = f"{trial.specimen.site}-{number}"
    preparations: Sequence[Preparation] = [
        replace(step, details={**step.details, "site": site})
        if isinstance(step, Ask) and step.request == "place_finger"
        else step
        for step in trial.preparations
    ]
    return replace(trial, preparations=tuple(preparations), specimen=replace(trial.specimen, site=site))
