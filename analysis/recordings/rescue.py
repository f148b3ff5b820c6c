"""Trials whose run was cut off, brought back: trimmed, phases completed, marked as recovered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Literal

from analysis.errors import BadInputError
from analysis.recordings.folders import find_trials
from analysis.recordings.locking import is_locked
from analysis.recordings.motion import phases_from_motion
from analysis.recordings.reading import read_trial
from analysis.recordings.trial import PHASE_NAMES, Phase, Trial
from analysis.recordings.writing import SOFTWARE, replace_trial, software_version


@dataclass(frozen=True, slots=True)
class RescueOutcome:
    """What was done with one file, in words for the operator."""

    path: Path
    action: str
    result: Literal["recovered", "left alone", "unreadable"]


def rescue_paths(paths: Sequence[Path]) -> list[RescueOutcome]:
    """Bring back the cut-off trials among files and folders; return what was done with each file.

    A file that is whole, or that is being written, is left alone; one that can't be read is reported and
    does not stop the others. Raises BadInputError where there are no trial files at all.
    """
    return [_rescue(path) for path in find_trials(paths)]


def _rescue(path: Path) -> RescueOutcome:
    try:
        if is_locked(path):
            return RescueOutcome(path, "is being written by another process: left alone", "left alone")
        trial = read_trial(path)
        if trial.status != "running":
            return RescueOutcome(path, f"is whole (status {trial.status}): left alone", "left alone")
        recovered = recovered_trial(trial)
        replace_trial(path, recovered)
    except BadInputError as error:
        return RescueOutcome(path, str(error).removeprefix(f"{path}: "), "unreadable")
    except OSError as error:
        reason = error.strerror or str(error)
        return RescueOutcome(path, f"can't be rescued ({reason}): check permissions and space", "unreadable")
    seconds = recovered.n_samples / recovered.sample_rate_hz
    named = ", ".join(phase.name for phase in recovered.phases) or "none"
    return RescueOutcome(
        path,
        f"recovered: {recovered.n_samples} samples ({seconds:.3f} s), phases {named}",
        "recovered",
    )


def recovered_trial(trial: Trial) -> Trial:
    """Return the trial of a file that was cut off, with its phases completed and its status set."""
    phases, words = _completed(trial)
    now = datetime.now().astimezone().isoformat(timespec="seconds")
    seconds = trial.n_samples / trial.sample_rate_hz
    program = f"{SOFTWARE} {software_version()}".strip()
    lines = (
        f"{now}: rescued by {program}: the run was cut off after {trial.n_samples} samples ({seconds:.4f} s)",
        words,
    )
    return replace(
        trial,
        status="recovered",
        status_reason=f"the run was cut off after {seconds:.3f} s; brought back by rescue",
        phases=phases,
        log=(*trial.log, *lines),
    )


def _completed(trial: Trial) -> tuple[tuple[Phase, ...], str]:
    """Return the phases to the last sample: those the run had written, the rest from the motion."""
    n = trial.n_samples
    if trial.kind == "air_sweep":
        return (Phase("sweep", 0, n),), "phases: one sweep, as the kind says"
    covered = trial.phases[-1].stop if trial.phases else 0
    if covered == n:
        return trial.phases, "phases: as the run had written them, cut at the last sample"
    if trial.kind not in {"ramp_hold_retract", "rigid_target"}:
        return trial.phases, "phases: as the run had written them"
    motion = trial.position_mm if trial.command_mm is None else trial.command_mm
    found = phases_from_motion(motion, trial.sample_rate_hz)
    last = PHASE_NAMES.index(trial.phases[-1].name) if trial.phases else 0
    tail = tuple(
        Phase(phase.name, max(phase.start, covered), phase.stop)
        for phase in found
        if phase.stop > covered and PHASE_NAMES.index(phase.name) >= last
    )
    if not tail:
        return trial.phases, f"phases: not known from sample {covered} on"
    kept = trial.phases
    if kept and kept[-1].name == tail[0].name and kept[-1].stop == tail[0].start:
        kept, tail = kept[:-1], (Phase(tail[0].name, kept[-1].start, tail[0].stop), *tail[1:])
    return (*kept, *tail), f"phases from sample {covered} on: found from the motion"
