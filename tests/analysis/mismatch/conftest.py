"""Small studies of a simulated bench as trial files, and what the diagnosis made of them."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock

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


Once = Callable[[str, Callable[[], list[Trial]]], Diagnosed]


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
    return Diagnosed(files, page.parent, report, list(faults))


@pytest.fixture(scope="session")
def diagnosed_once(tmp_path_factory: pytest.TempPathFactory, worker_id: str, watched_figures: Watch) -> Once:
    """Function (name, what records) -> what was made of the trials, once for all processes of a run of the tests."""
    own = tmp_path_factory.getbasetemp()
    folder = own if worker_id == "master" else own.parent

    def made(name: str, recorded: Callable[[], list[Trial]]) -> Diagnosed:
        kept = folder / f"{name}.pickle"
        with FileLock(folder / f"{name}.lock"):
            if kept.exists():
                found = pickle.loads(kept.read_bytes())
                assert isinstance(found, Diagnosed)
                return found
            found = diagnosed(folder / name, recorded(), watched_figures)
            kept.write_bytes(pickle.dumps(found))
            return found

    return made


@pytest.fixture(scope="session")
def clinging(record: Callable[..., list[Trial]], diagnosed_once: Once) -> Diagnosed:
    """A study on skin that clings to the punch."""
    return diagnosed_once("clinging", lambda: record(21, effect("adhesion", pull_off_mn=5.0)))


@pytest.fixture(scope="session")
def plain(record: Callable[..., list[Trial]], diagnosed_once: Once) -> Diagnosed:
    """A study on a bench that does what the simulation says."""
    return diagnosed_once("plain", lambda: record(22))


@pytest.fixture(scope="session")
def alone(record: Callable[..., list[Trial]], diagnosed_once: Once) -> Diagnosed:
    """A single trial."""
    plans = study_plans(depths_mm=(0.5,), repeats=1, **SHORT)
    return diagnosed_once("alone", lambda: record(23, plans=plans))
