"""Trials whose run was cut off, brought back: trimmed, phases completed, marked as recovered."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Literal

import numpy as np

from analysis.errors import BadInputError
from analysis.recordings.folders import find_trials
from analysis.recordings.live.cut_files import bytes_missing, read_cut_file
from analysis.recordings.live.locking import is_locked
from analysis.recordings.motion import SMEAR_S, Stretch, moves_and_rests, phases_from_motion
from analysis.recordings.opening import HDF5_ERRORS, reason_of
from analysis.recordings.reading import read_trial
from analysis.recordings.trial import Phase, Trial
from analysis.recordings.writing import (
    SOFTWARE,
    remove_leftovers,
    replace_trial,
    software_version,
    write_trial,
)


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
        if path.is_file() and bytes_missing(path):
            return _bring_back_cut_file(path)
        trial = read_trial(path)
        remove_leftovers(path)
        if trial.status != "running":
            return RescueOutcome(path, f"is whole (status {trial.status}): left alone", "left alone")
        recovered = recovered_trial(trial)
        replace_trial(path, recovered)
    except BadInputError as error:
        return RescueOutcome(path, str(error).removeprefix(f"{path}: "), "unreadable")
    except HDF5_ERRORS as error:
        return RescueOutcome(path, f"can't be rescued ({reason_of(error)}): left as it is", "unreadable")
    return _recovered(path, recovered)


def _bring_back_cut_file(path: Path) -> RescueOutcome:
    """Write what a file that lost its end still holds in its place, and keep it as it was beside."""
    kept = path.with_name(f"{path.name}.cut")
    if kept.exists():
        raise BadInputError(f"{path}: {kept.name} stands beside it already: move it away first")
    recovered = recovered_trial(read_cut_file(path))
    shutil.copy2(path, kept)
    write_trial(path, recovered)
    outcome = _recovered(path, recovered)
    return replace(outcome, action=f"{outcome.action}; the file had lost its end, it is kept as {kept.name}")


def _recovered(path: Path, trial: Trial) -> RescueOutcome:
    seconds = trial.n_samples / trial.sample_rate_hz
    named = ", ".join(phase.name for phase in trial.phases) or "none"
    action = f"recovered: {trial.n_samples} samples ({seconds:.3f} s), phases {named}"
    return RescueOutcome(path, action, "recovered")


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
    if trial.phases and trial.phases[-1].stop == n:
        return trial.phases, "phases: as the run had written them, cut at the last sample"
    motion = trial.position_mm if trial.command_mm is None else trial.command_mm
    if trial.phases:
        last = trial.phases[-1]
        found = _continued(last, moves_and_rests(motion, trial.sample_rate_hz), n, trial.sample_rate_hz)
        return (*trial.phases[:-1], *found), f"phases after sample {last.stop}: found from the motion"
    phases = phases_from_motion(motion, trial.sample_rate_hz)
    ramp = next((phase for phase in phases if phase.name == "ramp"), None)
    depth_mm = trial.protocol.depth_mm
    # a rest at the surface looks like a hold; only a push of the protocol's depth is taken for its ramp
    if ramp is None or depth_mm is None or abs(np.ptp(motion[ramp.samples]) - depth_mm) > 0.2 * depth_mm:
        return (), "phases: none, the run had written none and the motion does not show the protocol's ramp"
    return phases, "phases: found from the motion"


def _continued(last: Phase, stretches: Sequence[Stretch], n_samples: int, rate: float) -> tuple[Phase, ...]:
    """Return the phases from the last one written, which was still running, to the last sample.

    It goes on until the motion shows that the next one has begun.
    """
    shortest = 2 * SMEAR_S * rate
    phases = [last]
    pushed = any(stretch.sign > 0 and stretch.start < last.stop for stretch in stretches)
    for stretch in stretches:
        start = max(stretch.start, last.stop)
        if stretch.stop - start < shortest:
            continue
        now = phases[-1]
        name = _next_name(now.name, stretch.sign, pushed=pushed)
        pushed = pushed or stretch.sign > 0
        if name != now.name:
            phases[-1] = Phase(now.name, now.start, start)
            phases.append(Phase(name, start, stretch.stop))
    final = phases[-1]
    phases[-1] = Phase(final.name, final.start, n_samples)
    return tuple(phase for phase in phases if phase.stop > phase.start)


def _next_name(name: str, sign: int, *, pushed: bool) -> str:
    """Return the phase that a stretch of motion belongs to, after a phase of that name."""
    after = {
        ("approach", 0): "dwell" if pushed else "approach",
        ("dwell", 1): "ramp",
        ("ramp", 0): "hold",
        ("approach", -1): "retract",
        ("dwell", -1): "retract",
        ("ramp", -1): "retract",
        ("hold", -1): "retract",
        ("retract", 0): "clear",
    }
    return after.get((name, sign), name)
