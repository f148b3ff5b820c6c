"""Small studies of a simulated bench as trial files, and what the diagnosis made of them."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from analysis.recordings import write_trial
from analysis.recordings.trial import Trial
from sim_hardware.concealment.offline import TrialPlan, study_plans

BENCH = "seed = {seed}\n[specimens]\npublished_tissue = true\n"
Watch = Callable[[], AbstractContextManager[list[str]]]
SHORT = {"hold_s": 2.0, "dwell_s": 0.4}


@dataclass(frozen=True)
class Diagnosed:
    """A study, where it was diagnosed to, and the report."""

    trials: Path
    out: Path
    report: dict[str, Any]
    faults: Sequence[str] = ()
    """Texts of the figures that are cut off or printed over each other."""


def effect(name: str, **parameters: float) -> str:
    """Return an effect of the bench as TOML."""
    lines = [f"{key} = {value}" for key, value in parameters.items()]
    return "\n".join(["[[effects]]", f'name = "{name}"', *lines, ""])


def write_all(folder: Path, trials: Sequence[Trial]) -> Path:
    """Write trials as files of a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for i, trial in enumerate(trials):
        write_trial(folder / f"trial_{i:02d}.h5", trial)
    return folder


@pytest.fixture(scope="session")
def as_files() -> Callable[[Path, Sequence[Trial]], Path]:
    """Function that writes trials as files of a folder and returns the folder."""
    return write_all


@pytest.fixture(scope="session")
def record(bench_trials: Callable[..., list[Trial]]) -> Callable[..., list[Trial]]:
    """Function (seed, effects as TOML, plans) -> trials of a bench whose skin is everywhere the same."""

    def recorded(seed: int, effects: str = "", plans: Sequence[TrialPlan] | None = None) -> list[Trial]:
        return bench_trials(
            BENCH.format(seed=seed) + effects, plans or study_plans(depths_mm=(0.3, 0.7), repeats=4, **SHORT)
        )

    return recorded


def diagnosed(folder: Path, trials: Sequence[Trial], watched: Watch) -> Diagnosed:
    """Diagnose trials as the command does."""
    from analysis.mismatch.diagnose import diagnose_paths

    files = write_all(folder / "trials", trials)
    with watched() as faults:
        page = diagnose_paths([files], out=folder / "out")
    report = json.loads((page.parent / "report.json").read_text(encoding="utf-8"))
    return Diagnosed(files, page.parent, report, faults)


@pytest.fixture(scope="session")
def clinging(
    tmp_path_factory: pytest.TempPathFactory, record: Callable[..., list[Trial]], watched_figures: Watch
) -> Diagnosed:
    """A study on skin that clings to the punch."""
    trials = record(21, effect("adhesion", pull_off_mn=5.0))
    return diagnosed(tmp_path_factory.mktemp("clinging"), trials, watched_figures)


@pytest.fixture(scope="session")
def plain(
    tmp_path_factory: pytest.TempPathFactory, record: Callable[..., list[Trial]], watched_figures: Watch
) -> Diagnosed:
    """A study on a bench that does what the simulation says."""
    return diagnosed(tmp_path_factory.mktemp("plain"), record(22), watched_figures)


@pytest.fixture(scope="session")
def alone(
    tmp_path_factory: pytest.TempPathFactory, record: Callable[..., list[Trial]], watched_figures: Watch
) -> Diagnosed:
    """A single trial."""
    trials = record(23, plans=study_plans(depths_mm=(0.5,), repeats=1, **SHORT))
    return diagnosed(tmp_path_factory.mktemp("alone"), trials, watched_figures)
