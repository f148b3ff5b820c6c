"""The calibration routines: `indenter calibrate position|force`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

from rich.console import Console
from rich.table import Table

from analysis.errors import BadInputError
from rig.calibration.kept import FOLDER, calibration_folder, newest_calibration
from rig.calibration.lines import Constant, Line, student_95
from rig.commands.run import load_rig_or_simulated, run_on_bench
from rig.engine.bench import Bench
from rig.engine.routines import CalibrationRun, calibrate_with, routine
from rig.engine.session import open_bench
from rig.engine.tasks import Recorded, Task
from rig.protocols.steps import Plan
from rig.settings.protocol_file import ForceCalibration, PositionCalibration
from rig.settings.reading import check_protocol_on_rig

__all__ = ["calibrate", "calibrate_on_bench", "routine"]


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


def calibrate_on_bench(
    bench: Bench, protocol: PositionCalibration | ForceCalibration, folder: Path, console: Console
) -> Path:
    """Run a calibration on an open bench, show what it found, and write its file."""
    calibration = CalibrationRun(protocol, folder)

    def run(plan: Plan, tasks: Sequence[Task], out: Path) -> Sequence[Recorded]:
        return run_on_bench(bench, plan, tasks, out, console=console)

    result = calibrate_with(run, calibration)
    title = f"{result.kind.capitalize()} calibration"
    _show(console, title, result.x_name, result.line, result.constants)
    if "arm_mass_g" in result.about:
        mass_g = result.about["arm_mass_g"]
        console.print(f"mass of the arm as its tip feels it, m: {mass_g:.3f} g", highlight=False)
    return result.save(folder, bench.rig)


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
