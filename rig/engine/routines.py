"""A calibration as a run: its trials on an open bench, its points as they come, and what they add up to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np

from analysis.errors import BadInputError
from analysis.recordings import read_trial
from analysis.recordings.trial import Calibration
from rig.calibration.kept import save_calibration
from rig.calibration.lines import Constant, Line, force_constants, position_constants, student_95
from rig.engine.progress import CalibrationShown, MeasuredConstant
from rig.engine.tasks import Recorded, Task
from rig.protocols.planning import plan_of
from rig.protocols.steps import MoveStage, Plan
from rig.settings.protocol_file import ForceCalibration, PositionCalibration

Which = Literal["position", "force"]


@dataclass(frozen=True)
class CalibrationResult:
    """What a calibration found; nothing is kept until `save`."""

    kind: Which
    x_name: str
    constants: Mapping[str, Constant]
    line: Line
    valid_days: float
    about: Mapping[str, Any] = field(default_factory=dict)

    def save(self, folder: Path, rig: str) -> Path:
        """Write the calibration file, which later runs of the rig of this name load; return its path."""
        return save_calibration(
            folder,
            self.kind,
            self.constants,
            self.line,
            rig=rig,
            valid_days=self.valid_days,
            about=self.about,
        )

    def shown(self, in_use: Calibration) -> CalibrationShown:
        """Return what a snapshot tells of it, beside the constants in use."""
        points = tuple(zip(self.line.x.tolist(), self.line.y.tolist(), strict=True))
        constants = tuple(
            MeasuredConstant(
                name, constant.value, student_95(constant.dof) * constant.se, float(getattr(in_use, name))
            )
            for name, constant in self.constants.items()
        )
        return CalibrationShown(self.kind, self.x_name, points, constants, self.line.r2, decision="waiting")


class CalibrationRun:
    """One calibration: its plan and tasks, in a folder of their own below `folder`.

    Raises BadInputError where that can't be made.
    """

    def __init__(self, protocol: PositionCalibration | ForceCalibration, folder: Path) -> None:
        self.protocol = protocol
        self.kind: Which = "position" if isinstance(protocol, PositionCalibration) else "force"
        self.x_name = "stage, mm" if self.kind == "position" else "weight, mN"
        self.plan: Plan = plan_of(protocol, punch_diameter_mm=0.5)
        self.out = folder / f"{protocol.kind}-{datetime.now().astimezone():%Y%m%dT%H%M%S%f}"
        try:
            self.out.mkdir(parents=True)
        except OSError as error:
            raise BadInputError(
                f"{self.out}: can't be made ({error.strerror}): give another --out"
            ) from error
        self.tasks = [Task(trial, self.out / f"{trial.name}.h5") for trial in self.plan.trials]
        self._points: list[tuple[float, float]] = []

    def recorded(self, done: Recorded) -> CalibrationShown:
        """Return the points so far, that of this trial with them."""
        trial = read_trial(done.task.path)
        if done.task.trial.kind == "position_calibration" and trial.surface is not None:
            c = trial.calibration
            volts = trial.surface.position_mm * c.volts_per_mm + c.position_zero_v
            self._points.append((height_um(done) / 1e3, volts))
        dwell = trial.phase("dwell")
        if isinstance(self.protocol, ForceCalibration) and done.mass_g is not None and dwell is not None:
            volts = float(np.mean(trial.force_v[dwell.samples]))
            self._points.append((done.mass_g * self.protocol.gravity_m_s2, volts))
        return CalibrationShown(self.kind, self.x_name, tuple(self._points))

    def result(self, recorded: Sequence[Recorded]) -> CalibrationResult:
        """Return what the trials add up to. Raises BadInputError where too few of them were recorded."""
        if len(recorded) < len(self.tasks):
            raise BadInputError(
                f"{self.out}: {len(self.tasks) - len(recorded)} of {len(self.tasks)} points are missing: "
                "calibrate again, and leave none out"
            )
        if isinstance(self.protocol, PositionCalibration):
            return _position(self.protocol, recorded)
        return _force(self.protocol, recorded)


def calibrate_with(
    run: Callable[[Plan, Sequence[Task], Path], Sequence[Recorded]], calibration: CalibrationRun
) -> CalibrationResult:
    """Record the trials of a calibration by `run`, and return what they add up to."""
    return calibration.result(run(calibration.plan, calibration.tasks, calibration.out))


def routine(which: Which) -> PositionCalibration | ForceCalibration:
    """Return the routine as published."""
    if which == "position":
        return PositionCalibration(kind="position_calibration")
    return ForceCalibration(kind="force_calibration")


def height_um(done: Recorded) -> float:
    """Return where the stage stood in a trial of a position calibration, um."""
    return next(step.position_um for step in done.task.trial.preparations if isinstance(step, MoveStage))


def _position(protocol: PositionCalibration, recorded: Sequence[Recorded]) -> CalibrationResult:
    contacts = [
        (height_um(done), read_trial(done.task.path))
        for done in recorded
        if done.task.trial.kind == "position_calibration"
    ]
    sweep = read_trial(recorded[0].task.path)
    found = position_constants(contacts, sweep, sweep.calibration.position_zero_v)
    about = {"threshold_v": protocol.threshold_v, "x": "stage, mm"}
    return CalibrationResult("position", "stage, mm", found.constants, found.line, protocol.valid_days, about)


def _force(protocol: ForceCalibration, recorded: Sequence[Recorded]) -> CalibrationResult:
    hung = [(done.mass_g, read_trial(done.task.path)) for done in recorded if done.mass_g is not None]
    upright = read_trial(recorded[0].task.path)
    found = force_constants(hung, upright, protocol.gravity_m_s2, protocol.level_within_deg)
    about = {"arm_mass_g": found.arm_mass_g, "x": "weight, mN"}
    return CalibrationResult("force", "weight, mN", found.constants, found.line, protocol.valid_days, about)
