"""The calibration routines: `indenter calibrate position|force`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Literal

from rich.console import Console
from rich.table import Table

from analysis.errors import BadInputError
from analysis.recordings import read_trial
from rig.calibration.kept import (
    FOLDER,
    calibration_folder,
    newest_calibration,
    save_calibration,
)
from rig.calibration.lines import (
    Constant,
    Line,
    force_constants,
    position_constants,
    student_95,
)
from rig.commands.run import load_rig_or_simulated, run_on_bench
from rig.engine.bench import Bench
from rig.engine.runner import Recorded, Task
from rig.engine.session import open_bench
from rig.protocols.planning import plan_of
from rig.protocols.steps import MoveStage
from rig.settings.protocol_file import ForceCalibration, PositionCalibration
from rig.settings.reading import check_protocol_on_rig


def calibrate(which: Literal["position", "force"], *, rig: Path | None, out: Path | None) -> Path:
    """Run a calibration on a bench; return the calibration file, which later runs of this rig load.

    The trials it rests on are kept in a folder beside the file. `out` is the folder of calibrations, by
    default the one of the rig file. Raises BadInputError and RigError as a run does.
    """
    settings = load_rig_or_simulated(rig)
    folder = out or calibration_folder(settings, rig) or Path(FOLDER)
    if folder.exists() and not folder.is_dir():
        raise BadInputError(f"{folder}: is a file, not a folder: give another --out")
    protocol = routine(which)
    check_protocol_on_rig(protocol, settings, f"calibrate {which}")
    constants, _ = newest_calibration(settings, folder if folder.exists() else None)
    with open_bench(settings, constants) as bench:
        return calibrate_on_bench(bench, protocol, folder, Console(stderr=True))


def routine(which: Literal["position", "force"]) -> PositionCalibration | ForceCalibration:
    """Return the routine as published."""
    if which == "position":
        return PositionCalibration(kind="position_calibration")
    return ForceCalibration(kind="force_calibration")


def calibrate_on_bench(
    bench: Bench, protocol: PositionCalibration | ForceCalibration, folder: Path, console: Console
) -> Path:
    """Run a calibration on an open bench, show what it found, and write its file."""
    plan = plan_of(protocol, punch_diameter_mm=0.5)
    trials = folder / f"{protocol.kind}-{datetime.now().astimezone():%Y%m%dT%H%M%S%f}"
    try:
        trials.mkdir(parents=True)
    except OSError as error:
        raise BadInputError(f"{trials}: can't be made ({error.strerror}): give another --out") from error
    tasks = [Task(trial, trials / f"{trial.name}.h5") for trial in plan.trials]
    recorded = run_on_bench(bench, plan, tasks, trials, console=console)
    if isinstance(protocol, PositionCalibration):
        return _position(protocol, recorded, folder, console, bench.rig)
    return _force(protocol, recorded, folder, console, bench.rig)


def _position(
    protocol: PositionCalibration, recorded: Sequence[Recorded], folder: Path, console: Console, rig: str
) -> Path:
    contacts = [
        (_height_um(done), read_trial(done.task.path))
        for done in recorded
        if done.task.trial.kind == "position_calibration"
    ]
    sweep = read_trial(recorded[0].task.path)
    result = position_constants(contacts, sweep, sweep.calibration.position_zero_v)
    _show(console, "Position calibration", "stage, mm", result.line, result.constants)
    return save_calibration(
        folder,
        "position",
        result.constants,
        result.line,
        rig=rig,
        valid_days=protocol.valid_days,
        about={"threshold_v": protocol.threshold_v, "x": "stage, mm"},
    )


def _height_um(done: Recorded) -> float:
    return next(step.position_um for step in done.task.trial.preparations if isinstance(step, MoveStage))


def _force(
    protocol: ForceCalibration, recorded: Sequence[Recorded], folder: Path, console: Console, rig: str
) -> Path:
    hung = [(done.mass_g, read_trial(done.task.path)) for done in recorded if done.mass_g is not None]
    upright = read_trial(recorded[0].task.path)
    result = force_constants(hung, upright, protocol.gravity_m_s2, protocol.level_within_deg)
    _show(console, "Force calibration", "weight, mN", result.line, result.constants)
    console.print(f"mass of the arm as its tip feels it, m: {result.arm_mass_g:.3f} g", highlight=False)
    return save_calibration(
        folder,
        "force",
        result.constants,
        result.line,
        rig=rig,
        valid_days=protocol.valid_days,
        about={"arm_mass_g": result.arm_mass_g, "x": "weight, mN"},
    )


def _show(console: Console, title: str, x_name: str, line: Line, constants: Mapping[str, Constant]) -> None:
    points = Table(title=f"{title}: points", title_justify="left")
    for column in (x_name, "V", "residual, mV"):
        points.add_column(column, justify="right")
    for x, y, residual in zip(line.x, line.y, line.residuals, strict=True):
        points.add_row(f"{x:.4g}", f"{y:.5f}", f"{1e3 * residual:+.3f}")
    console.print(points)
    found = Table(title=f"{title}: constants, R2 = {line.r2:.8f}", title_justify="left")
    for column in ("constant", "value", "standard error", "95 % interval, +-"):
        found.add_column(column, justify="right")
    for name, constant in constants.items():
        half = student_95(constant.dof) * constant.se
        found.add_row(name, f"{constant.value:.6g}", f"{constant.se:.2g}", f"{half:.2g}")
    console.print(found)
