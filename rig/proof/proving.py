"""Proof on data where effects are concealed: `indenter prove`."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import tomlkit
from rich.console import Console

from analysis.errors import BadInputError
from rig.commands.run import SIMULATED_RIG, run_protocol_file
from rig.errors import RigError
from rig.proof.keeper import Keeper, Opened
from rig.proof.page import ScoredCase, case_data, print_tables, write_page
from rig.proof.scores import read_truth
from rig.protocols.studying import design, rests_s, study_trials
from rig.settings.protocol_file import Study
from rig.settings.reading import load_protocol

_STUDY = """# The study that every concealed case is recorded with: every trial at a site of its own.
kind = "study"

[study]
subject = "proof"
fingers = ["thumb", "index", "middle", "ring", "little"]
depths_mm = [0.2, 0.4, 0.6, 0.8]
repeats = 1
rest_s = [120.0, 180.0]
order = "shuffled"
seed = {seed}

[surface]
start_mm = 2.5
samples_per_read = 40
"""


@dataclass(frozen=True, slots=True)
class Diagnosed:
    """A case recorded and diagnosed: its report, or None where ``failure`` says why there is none."""

    number: int
    report: Mapping[str, Any] | None
    failure: str
    record_s: float
    diagnose_s: float


def run_proof(*, cases: int, seed: int, out: Path) -> Path:
    """Conceal, seal, record, diagnose, open and score; return the page's path.

    A case that can't be recorded or diagnosed is counted as failed. Raises BadInputError where ``out`` holds
    something already, RigError where a seal does not fit.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise BadInputError(f"{out}: is there already: give another --out, or remove it")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInputError(f"{out}: can't be written ({error.strerror}): give another --out") from error
    console = Console(stderr=True)
    console.print("[bold]Seals[/bold]  (SHA-256 over a salt and the truth, of what each bench conceals)")

    def drawn(number: int, seal: str) -> None:
        console.print(f"  case {number:3d}  {seal}", highlight=False, soft_wrap=True)

    study = out / "study.toml"
    study.write_text(_STUDY.format(seed=seed), encoding="utf-8")
    trials = planned(study)
    with Keeper(cases, seed, trials, drawn) as keeper:
        _write(out / "seals.json", keeper.seals)
        diagnosed = [_one_case(keeper, number, seed, out, console) for number in range(cases)]
        opened = keeper.open()
    _write(out / "truths.json", [{"salt": o.salt, "truth": o.text} for o in opened])
    return _scored(diagnosed, opened, keeper.seals, seed, len(trials), out)


def planned(path: Path) -> list[dict[str, str | float]]:
    """Return what the keeper is told of a study: finger, site, repeat, depth, rest of each indentation."""
    study = load_protocol(path)
    assert isinstance(study, Study)
    cells = design(study)
    found: list[dict[str, str | float]] = []
    rests = rests_s(study.study, len(cells))
    for cell, rest_s, trial in zip(cells, rests, study_trials(study, 0.5, ""), strict=True):
        whose = trial.specimen
        found.append(
            {
                "finger": whose.finger,
                "site": whose.site,
                "repeat": cell.repeat,
                "depth_mm": cell.depth_mm,
                "rest_s": rest_s,
            }
        )
    return found


def _one_case(keeper: Keeper, number: int, seed: int, out: Path, console: Console) -> Diagnosed:
    """Record a case through the rig and have a process diagnose it that is given the trial files alone."""
    folder = out / f"case_{number:03d}"
    folder.mkdir()
    rig, study = folder / "rig.toml", out / "study.toml"
    rig.write_text(_rig_text(keeper.companion(number)), encoding="utf-8")
    console.print(f"\n[bold]Case {number}[/bold]: record", highlight=False)
    started = time.monotonic()
    try:
        trials = run_protocol_file(study, rig=rig, out=folder / "trials")
    except RigError as error:  # one bench that fails is told and counted, the others go on
        console.print(f"[bold]Case {number}[/bold]: {error}", style="red", highlight=False, soft_wrap=True)
        return Diagnosed(number, None, f"recording failed: {error}", time.monotonic() - started, 0.0)
    recorded = time.monotonic()
    console.print(f"[bold]Case {number}[/bold]: diagnose", highlight=False)
    report, failure = _diagnose(trials, folder / "diagnosis", seed)
    ended = time.monotonic()
    console.print(
        f"[bold]Case {number}[/bold]: {report['verdict'] if report else failure}"
        f"  (recorded in {recorded - started:.0f} s, diagnosed in {ended - recorded:.0f} s)",
        highlight=False,
        soft_wrap=True,
    )
    return Diagnosed(number, report, failure, recorded - started, ended - recorded)


def _rig_text(companion: Sequence[str]) -> str:
    """Return the simulated rig's file with a companion whose settings nobody here knows."""
    rig = tomlkit.parse((files("rig.examples") / SIMULATED_RIG).read_text(encoding="utf-8"))
    table = tomlkit.table()
    table.add("command", list(companion))
    table.add("settings", tomlkit.table())
    rig["companion"] = table
    return tomlkit.dumps(rig)


def _diagnose(trials: Path, out: Path, seed: int) -> tuple[Mapping[str, Any] | None, str]:
    """Run `indenter diagnose` on trial files as a process of its own; return its report or why none."""
    command = [
        sys.executable,
        "-m",
        "rig.cli",
        "diagnose",
        str(trials),
        "--out",
        str(out),
        "--seed",
        str(seed),
    ]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    report = out / "report.json"
    if ended.returncode == 0 and report.exists():
        found: dict[str, Any] = json.loads(report.read_text(encoding="utf-8"))
        return found, ""
    words = ended.stderr.strip().splitlines()
    return (
        None,
        f"diagnosis failed (exit code {ended.returncode}): {words[-1] if words else 'no reason given'}",
    )


def _scored(
    diagnosed: Sequence[Diagnosed],
    opened: Sequence[Opened],
    seals: Sequence[str],
    seed: int,
    trials: int,
    out: Path,
) -> Path:
    """Score what was diagnosed against what was opened; write the proof and return its page."""
    cases = [
        ScoredCase(read_truth(o.truth), d.report, d.failure, d.record_s, d.diagnose_s, sealed, o.salt)
        for d, o, sealed in zip(diagnosed, opened, seals, strict=True)
    ]
    found = print_tables(cases)
    _write(
        out / "proof.json",
        {
            "format": "indenter-proof",
            "format_version": 1,
            "seed": seed,
            "trials_a_case": trials,
            "figures": [asdict(f) for f in found],
            "cases": [case_data(c) for c in cases],
        },
    )
    return write_page(out, cases, seed=seed, trials=trials)


def _write(path: Path, data: object) -> None:
    path.write_text(json.dumps(data, indent=1), encoding="utf-8")
