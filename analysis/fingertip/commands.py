"""What `indenter fingertip` does: from files to files."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from analysis.errors import BadInputError


def write_example(folder: Path) -> Path:
    """Write the shipped pad.toml into a folder; BadInputError where one lies there already."""
    from analysis.fingertip.pad_file import EXAMPLE, example_text

    path = folder / EXAMPLE
    if path.exists():
        raise BadInputError(f"{path}: is there already: choose another folder, or remove it")
    with _writing_to(folder):
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(example_text(), encoding="utf-8")
    return path


def calibrate_pads(
    fits: Path, *, pad: Path | None, out: Path, finger: str | None, cache: Path | None
) -> Path:
    """Calibrate homogeneous and layered pads on the fits; write table, page, rig files, VTU; return the page."""
    from analysis.fingertip.cache import cache_folder
    from analysis.fingertip.calibrate import LAYERED_RATIO, calibrate, scan, target_of
    from analysis.fingertip.calibration_file import Calibration, write_calibration
    from analysis.fingertip.fits_file import mean_trial, read_fits
    from analysis.fingertip.pad_file import read_pad
    from analysis.fingertip.page import write_calibration_page
    from analysis.fingertip.specimen import write_specimen

    settings = read_pad(pad)
    trials = read_fits(fits, finger)
    measured = mean_trial(trials)
    need_solver()
    from analysis.fingertip.punch import punch_pad

    with _writing_to(out):
        out.mkdir(parents=True, exist_ok=True)
    punch = punch_pad(settings, cache_folder(cache))
    target = target_of(measured)
    terms = settings.calibration.prony_terms
    pads = (
        calibrate(punch, target, "homogeneous", 1.0, terms),
        calibrate(punch, target, "layered", LAYERED_RATIO, terms),
    )
    found = Calibration(settings, measured, pads, tuple(scan(punch, target, terms)))
    with _writing_to(out):
        write_calibration(out, found)
        for one in pads:
            write_specimen(out / f"{one.kind}_rig.toml", one, settings.punch.diameter_mm)
        return write_calibration_page(out, found, target, punch, trials)


def compare_surface(
    surface: Path, *, out: Path, depth_mm: float, speed_mm_s: float, hold_s: float, cache: Path | None
) -> Path:
    """Set a measured surface beside the calibrated pads of ``out``; write table, page and VTU; return the page."""
    from analysis.fingertip.cache import cache_folder
    from analysis.fingertip.calibration_file import read_calibration
    from analysis.fingertip.surface_file import read_surface

    measured = read_surface(surface, depth_mm)
    found = read_calibration(out)
    need_solver()
    from analysis.fingertip.compare import locate
    from analysis.fingertip.line_load import LineMotion, answer_lines
    from analysis.fingertip.page import write_comparison_page

    answers = answer_lines(found, LineMotion(depth_mm, speed_mm_s, hold_s), cache_folder(cache))
    low, high = answers.position_mm[[0, -1]].tolist()
    inside = (measured.position_mm >= low) & (measured.position_mm <= high)
    if not inside.all():
        raise BadInputError(
            f"{surface}: {int((~inside).sum())} places lie beyond the pad, which reaches from {low:.1f} "
            f"to {high:.1f} mm from the line: leave them out"
        )
    located = locate(measured, answers)
    with _writing_to(out):
        return write_comparison_page(out, located, answers)


def predict_receptor(
    *, out: Path, rates: Path | None, shallowest_mm: float, deepest_mm: float, cache: Path | None
) -> Path:
    """Press a plate into the calibrated pads of ``out``; write energies and page; return the page."""
    from analysis.fingertip.cache import cache_folder
    from analysis.fingertip.calibration_file import read_calibration
    from analysis.fingertip.receptor import PlateMotion, feel, plate_pad, read_rates, write_energies

    rate = read_rates(rates) if rates is not None else None
    found = read_calibration(out)
    need_solver()
    from analysis.fingertip.receptor_page import write_receptor_page

    motion = PlateMotion()
    models = [plate_pad(found.pad, pad, cache_folder(cache)) for pad in found.pads]
    depth_mm = models[0].depth_mm
    if not depth_mm[0] <= shallowest_mm < deepest_mm <= depth_mm[-1]:
        raise BadInputError(
            f"depths from {shallowest_mm:g} to {deepest_mm:g} mm: give them rising, between {depth_mm[0]:.2f} "
            f"and {depth_mm[-1]:.2f} mm"
        )
    felt = [feel(found.pad, model, pad, motion) for model, pad in zip(models, found.pads, strict=True)]
    with _writing_to(out):
        write_energies(out / "receptor.csv", felt)
        return write_receptor_page(out, felt, motion, (shallowest_mm, deepest_mm), rate)


def need_solver() -> None:
    """Raise BadInputError where the finite-element library is not installed."""
    try:
        import ngsolve
    except ImportError as error:
        raise BadInputError(
            "indenter fingertip needs the optional extra: install it with `pip install indenter[fingertip]`"
        ) from error
    # one thread: on two cores more of them only wait for each other
    ngsolve.SetNumThreads(1)
    ngsolve.ngsglobals.msg_level = 0


@contextmanager
def _writing_to(out: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise BadInputError(
            f"{error.filename or out}: can't be written ({error.strerror}): choose another --out"
        ) from error
