"""The main job on the simulated rig, start to end: `indenter demo`."""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

from rich.console import Console

from analysis.errors import BadInputError
from rig.commands.calibrate import calibrate
from rig.commands.run import SIMULATED_RIG, run_protocol_file

_SURFACE = """kind = "surface_detection"

[specimen]
subject = "demo"
finger = "index"
"""

_STUDY = """# A small study, as `indenter demo` runs it.
kind = "study"

[study]
subject = "demo"
fingers = ["index", "middle"]
depths_mm = [0.2, 0.4, 0.6, 0.8]
repeats = 2
rest_s = [120.0, 180.0]

[surface]
start_mm = 2.5                        # the skin of this bench lies between 3 and 6 mm
samples_per_read = 40
"""

_CONCEALED = """
# what this bench conceals from the simulation, for `indenter diagnose` to find
[[companion.settings.effects]]
name = "adhesion"
pull_off_mn = 5.0
"""


def run_demo(out: Path) -> Path:
    """Calibrate, find the skin, run a small study, fit and diagnose it; return the folder of the results.

    Everything goes through the driver's own client to a simulated bench, which runs as fast as it can. Raises
    BadInputError where `out` holds something already.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise BadInputError(f"{out}: is there already: give another --out, or remove it")
    console = Console(stderr=True)
    started = time.monotonic()
    rig, surface, study = _write_files(out)

    def step(number: int, words: str, work: Callable[[], Path]) -> Path:
        console.print(f"\n[bold]{number}/6  {words}[/bold]", highlight=False, soft_wrap=True)
        return work()

    step(1, "Calibrate position: a block on the Z stage, found at six heights", _calibrated("position", rig))
    step(2, "Calibrate force: weights hung from the inverted arm", _calibrated("force", rig))
    step(
        3,
        "Find the skin of the index finger",
        lambda: run_protocol_file(surface, rig=rig, out=out / "surface"),
    )
    trials = step(
        4,
        "A small study: 2 fingers, 4 depths, 2 repeats at 8000 samples a second, with its rests "
        "(the time left is the bench's, which passes as fast as the computer can)",
        lambda: run_protocol_file(study, rig=rig, out=out / "trials"),
    )
    page = step(5, "Fit the relaxation of every trial", lambda: _fit(trials, out / "fits"))
    report = step(
        6, "Diagnose: what does the simulation leave out?", lambda: _diagnose(trials, out / "diagnosis")
    )
    console.print(
        f"\nDone in {time.monotonic() - started:.0f} s. Results in {out}:\n"
        f"  calibrations  {out / 'calibrations'}\n"
        f"  trials        {trials}\n"
        f"  fits          {page}\n"
        f"  diagnosis     {report}\n"
        f"The bench concealed an adhesion of 5 mN; see whether the diagnosis found it.",
        highlight=False,
        soft_wrap=True,
    )
    return out


def _write_files(out: Path) -> tuple[Path, Path, Path]:
    """Write the rig file and the two protocols, so that the demo can be repeated by hand."""
    simulated = (files("rig.examples") / SIMULATED_RIG).read_text(encoding="utf-8")
    texts = {"rig.toml": simulated + _CONCEALED, "surface.toml": _SURFACE, "study.toml": _STUDY}
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            (out / name).write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInputError(f"{out}: can't be written ({error.strerror}): give another --out") from error
    return out / "rig.toml", out / "surface.toml", out / "study.toml"


def _calibrated(which: str, rig: Path) -> Callable[[], Path]:
    return lambda: calibrate("position" if which == "position" else "force", rig=rig, out=None)


def _fit(trials: Path, out: Path) -> Path:
    from analysis.relaxation.batch import fit_paths

    return fit_paths([trials], model="ramp", out=out)


def _diagnose(trials: Path, out: Path) -> Path:
    from analysis.mismatch.diagnose import diagnose_paths

    return diagnose_paths([trials], out=out)
