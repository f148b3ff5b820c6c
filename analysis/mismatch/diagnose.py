"""`indenter diagnose`: from trial files to the report, the twin and the next protocol."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from analysis.errors import BadInputError

if TYPE_CHECKING:
    from analysis.mismatch.diagnosis import Diagnosis
    from analysis.mismatch.report.contents import Report
    from analysis.mismatch.study.intake import Intake

FILES = ("report.html", "report.json", "twin.toml", "next.toml")
BASELINES = ("ramp", "step")


def diagnose_paths(
    paths: Sequence[Path],
    *,
    baseline: str = "ramp",
    out: Path,
    seed: int = 0,
    tolerance_mn: float = 0.3,
    show: Callable[[Report], None] | None = None,
) -> Path:
    """Compare simulation and recordings, and write what was found into ``out``; return the page's path.

    Writes `report.json`, `report.html`, figures, `twin.toml`, and `next.toml` where something needs
    separating: all of them, or on failure nothing. ``tolerance_mn`` (rms): what a law may leave over in any
    window without being called unknown. ``show`` is given the report once it is written. Trials that can't be used
    are left out, each with its reason in the report; raises BadInputError, one line, where none is left.
    """
    if baseline not in BASELINES:
        raise BadInputError(f"baseline {baseline!r} is unknown: use ramp or step")
    if not tolerance_mn > 0:
        raise BadInputError(f"tolerance {tolerance_mn:g} mN can't be met: give one above 0")
    if out.exists() and not out.is_dir():
        raise BadInputError(f"{out}: is a file: choose another --out")
    from analysis.mismatch.study.intake import take_in
    from analysis.recordings import find_trials

    files = find_trials(paths)
    with _status(f"Reading {len(files)} files") as say:
        taken = take_in(files, hold_only=baseline == "step")
        say(f"Comparing {len(taken.trials)} trials with the simulation and every mechanism of the library")
        diagnosis = _diagnosed(taken, baseline, seed)
        say("Writing the report")
        with _together(out) as folder:
            report = _write(folder, diagnosis, baseline=baseline, seed=seed, tolerance_mn=tolerance_mn)
    if show is not None:
        show(report)
    return out / FILES[0]


def _diagnosed(taken: Intake, baseline: str, seed: int) -> Diagnosis:
    """Return the diagnosis; trials that by themselves defeat the arithmetic are left out, not the others with them."""
    from analysis.mismatch.diagnosis import diagnose
    from analysis.mismatch.study.intake import UNCOMPUTABLE, without_trials

    try:
        return diagnose(taken, baseline=baseline, seed=seed)
    except BadInputError:
        raise
    except UNCOMPUTABLE as error:
        together = error
    reasons = {j: why for j in range(len(taken.trials)) if (why := _why_not_alone(taken, j, baseline))}
    if reasons and len(reasons) < len(taken.trials):
        return _diagnosed(without_trials(taken, reasons), baseline, seed)
    first = Path(taken.trials[0].label).name
    which = first if len(taken.trials) == 1 else f"{first} and {len(taken.trials) - 1} more"
    raise BadInputError(
        f"{which}: the comparison with the simulation can't be calculated ({' '.join(str(together).split())}): "
        "look at the recordings with `indenter fit`, and leave out what is no press and hold"
    ) from together


def _why_not_alone(taken: Intake, j: int, baseline: str) -> str:
    """Return why the baseline simulation can't be fitted to one trial alone; nothing where it can."""
    from analysis.mismatch.fit.baseline import fit_baseline
    from analysis.mismatch.study.intake import UNCOMPUTABLE

    try:
        fit_baseline(taken.trials[j : j + 1], ideal_step=baseline == "step")
    except UNCOMPUTABLE as error:
        return f"the simulation can't be fitted to it ({' '.join(str(error).split())})"
    return ""


def _write(folder: Path, diagnosis: Diagnosis, *, baseline: str, seed: int, tolerance_mn: float) -> Report:
    from analysis.mismatch.propose.experiment import propose
    from analysis.mismatch.report.figures import draw_figures
    from analysis.mismatch.report.page import write_page
    from analysis.mismatch.report.setting import in_words_of_its_bench
    from analysis.mismatch.report.twin import write_twin
    from analysis.mismatch.report.verdict import make_report, with_summary

    report = make_report(diagnosis, baseline=baseline, seed=seed, tolerance_mn=tolerance_mn)
    report = replace(report, next_experiment=propose(diagnosis, folder / "next.toml"))
    report = in_words_of_its_bench(with_summary(report, diagnosis))
    write_twin(folder / "twin.toml", diagnosis, report)
    figures = draw_figures(folder, diagnosis, report)
    write_page(folder / "report.html", report, figures)
    text = json.dumps(report.as_json(), indent=1, allow_nan=False, ensure_ascii=False)
    (folder / "report.json").write_text(text + "\n", encoding="utf-8")
    return report


@contextmanager
def _status(words: str) -> Iterator[Any]:
    """Show what is being done, on stderr, where that is a terminal."""
    from rich.console import Console

    console = Console(stderr=True)
    with console.status(words) as status:
        yield status.update


@contextmanager
def _together(out: Path) -> Iterator[Path]:
    """Write into a folder beside the target, and move its files there only when all of them exist."""
    made = not out.exists()
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInputError(f"{out}: can't be made ({error.strerror}): choose another --out") from error
    finished = False
    try:
        with tempfile.TemporaryDirectory(prefix=".diagnosis-", dir=out) as folder:
            yield Path(folder)
            for name in FILES:
                (out / name).unlink(missing_ok=True)  # of an earlier diagnosis, which may have had others
            for file in sorted(Path(folder).iterdir()):
                shutil.move(file, out / file.name)
            finished = True
    except OSError as error:
        raise BadInputError(f"{out}: can't be written to ({error.strerror}): choose another --out") from error
    finally:
        if made and not finished and out.is_dir() and not any(out.iterdir()):
            out.rmdir()
