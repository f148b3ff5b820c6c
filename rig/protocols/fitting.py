"""Whether a plan fits: how many trials, how long, how much memory and disk, worked out before anything moves."""

from __future__ import annotations

import math
import shutil
from dataclasses import dataclass
from pathlib import Path

import psutil

from analysis.errors import BadInputError
from rig.protocols.calibrating import number_of_heights
from rig.protocols.steps import Approach, Plan, expected_duration_s
from rig.protocols.studying import number_of_trials
from rig.settings.protocol_file import AirSweep, ForceCalibration, PositionCalibration, Protocol, Study
from rig.settings.rig_file import RigFile

MOST_TRIALS = 10_000
"""More than a year of sessions; a plan of that many is a slip of the keyboard."""

LONGEST_S = 30 * 86_400.0
LONGEST_TRIAL_S = 6 * 3600.0
"""No finger lies still for six hours."""

_BYTES_A_SAMPLE = 3 * 8
_COPIES = 2
"""A trial's file is written whole once more at its end, beside the running one."""

_MEMORY_COPIES = 4
"""The engine holds a trial once, the writer of the finished file up to three times more."""

_MEMORY_SHARE = 0.5
_DISK_SHARE = 0.95


@dataclass(frozen=True, slots=True)
class Needs:
    """What a plan takes: time of the bench, s; the longest trial, s; bytes of memory and disk."""

    n_trials: int
    duration_s: float
    longest_trial_s: float
    memory_bytes: float
    disk_bytes: float


def check_number(protocol: Protocol, origin: str) -> None:
    """Refuse (BadInputError) a protocol whose trials are too many to be even listed."""
    match protocol:
        case Study():
            n = number_of_trials(protocol)
        case PositionCalibration():
            n = number_of_heights(protocol) * protocol.repeats + 2
        case ForceCalibration():
            n = len(protocol.masses_g) * protocol.repeats + 1
        case AirSweep():
            n = len(protocol.sweep_speeds_mm_s)
        case _:
            n = 1
    if n > MOST_TRIALS:
        raise BadInputError(
            f"{origin}: asks for {n} trials, more than {MOST_TRIALS}: take fewer, or larger steps"
        )


def needs_of(plan: Plan, rig: RigFile) -> Needs:
    """Return what a plan takes on a rig."""
    travel_mm = rig.lever.travel_max_mm - rig.lever.travel_min_mm
    longest_s = [trial.longest_s(travel_mm) for trial in plan.trials]
    expected_s = [
        sum(
            expected_duration_s(motion)
            if not isinstance(motion, Approach)
            else travel_mm / 2 / motion.speed_mm_s
            for motion in trial.motions
        )
        for trial in plan.trials
    ]
    rate_hz = rig.card.sample_rate_hz
    most_s = max(longest_s, default=0.0)
    return Needs(
        n_trials=len(plan.trials),
        duration_s=plan.expected_s,
        longest_trial_s=most_s,
        memory_bytes=_MEMORY_COPIES * _BYTES_A_SAMPLE * rate_hz * most_s,
        disk_bytes=_BYTES_A_SAMPLE * rate_hz * (sum(expected_s) + _COPIES * most_s),
    )


def check_fits(plan: Plan, rig: RigFile, out: Path, origin: str) -> None:
    """Refuse (BadInputError), with the figure, a plan that the day, the memory or the disk can't hold.

    `out`: the folder of the trials, which need not exist yet.
    """
    needs = needs_of(plan, rig)
    free = shutil.disk_usage(_existing(out)).free
    memory = psutil.virtual_memory().total
    for what, value, most, unit, todo in (
        ("lasts", needs.duration_s / 3600, LONGEST_S / 3600, "h", "take fewer trials, or shorter rests"),
        (
            "has a trial that may record for",
            needs.longest_trial_s / 3600,
            LONGEST_TRIAL_S / 3600,
            "h",
            "shorten its hold, or raise its speeds",
        ),
        (
            "has a trial that needs",
            needs.memory_bytes / 1e9,
            _MEMORY_SHARE * memory / 1e9,
            "GB of memory",
            "shorten its hold, or raise its speeds",
        ),
        (
            "needs",
            needs.disk_bytes / 1e9,
            _DISK_SHARE * free / 1e9,
            f"GB of disk at {out}",
            "make room, or shorten",
        ),
    ):
        if not (math.isfinite(value) and value <= most):
            raise BadInputError(f"{origin}: {what} {value:.3g} {unit}, and {most:.3g} are allowed: {todo}")


def _existing(folder: Path) -> Path:
    """The folder, or the nearest above it that exists."""
    folder = folder.absolute()
    while not folder.is_dir() and folder != folder.parent:
        folder = folder.parent
    return folder
