"""Where a run was: what its folder holds already, what is still to do, and under which names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from analysis.errors import BadInputError
from analysis.recordings import read_trial
from analysis.recordings.trial import Trial
from rig.engine.attempts import next_attempt, planned_name
from rig.engine.tasks import Task
from rig.protocols.steps import Plan

PROTOCOL_FILE = "protocol.toml"


@dataclass(frozen=True, slots=True)
class Standing:
    """What a folder says of a run: the tasks still to do, and how many are done."""

    tasks: tuple[Task, ...]
    n_done: int


def standing(plan: Plan, toml: str, out: Path) -> Standing:
    """Return what is left of a plan in the folder `out`, which need not exist.

    A trial counts as done where a file of its name is complete and not discarded; otherwise it is recorded
    again under a new name, at a new site. Raises BadInputError where the folder holds another protocol, or
    trials of none.
    """
    if out.exists() and not out.is_dir():
        raise BadInputError(f"{out}: is a file, not a folder: give another --out")
    _check_same(toml, out)
    attempts: dict[str, list[Path]] = {}
    for path in sorted(out.glob("*.h5")):
        attempts.setdefault(planned_name(path.stem), []).append(path)
    tasks, n_done = [], 0
    for trial in plan.trials:
        earlier = attempts.get(trial.name, [])
        if any(_counts(path) for path in earlier):
            n_done += 1
        else:
            tasks.append(next_attempt(trial, out, [path.stem for path in earlier]))
    return Standing(tuple(tasks), n_done)


def keep_protocol(toml: str, out: Path) -> None:
    """Make the folder and keep the protocol's text in it, so that a later run knows what it holds."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        (out / PROTOCOL_FILE).write_text(toml, encoding="utf-8")
    except OSError as error:
        raise BadInputError(f"{out}: can't be written ({error.strerror}): give another --out") from error


def _check_same(toml: str, out: Path) -> None:
    kept = out / PROTOCOL_FILE
    if kept.exists():
        if kept.read_text(encoding="utf-8") != toml:
            raise BadInputError(
                f"{out}: holds a run of another protocol (its {PROTOCOL_FILE} differs): give another --out"
            )
    elif any(out.glob("*.h5")):
        raise BadInputError(f"{out}: holds trials of something else (no {PROTOCOL_FILE}): give another --out")


def _counts(path: Path) -> bool:
    """Whether a file is a good trial; one that was cut off or can't be read is not."""
    try:
        trial: Trial = read_trial(path)
    except BadInputError:
        return False
    return trial.status == "complete" and not trial.discarded
