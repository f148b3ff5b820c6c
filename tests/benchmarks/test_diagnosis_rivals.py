"""The diagnosis beside what a user would try instead, on the same concealed cases on living skin."""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

import pytest
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent))

import campaign
import measured
import rivals
from rivals import Said

from analysis.recordings import find_trials, read_trial
from sim_hardware.concealment.cases import draw_case

CASES: list[campaign.Spec] = [
    ("null", (), "white"),
    ("single", ("adhesion",), "white"),
    ("null", (), "correlated"),
    ("single", ("coulomb_friction",), "correlated"),
    ("null", (), "heavy_tails"),
    ("single", ("stiffening",), "white"),
    ("null", (), "one_over_f"),
    ("single", ("parallel_dashpot",), "one_over_f"),
    ("single", ("arm_inertia",), "white"),
    ("single", ("force_lag",), "wandering"),
    ("single", ("force_drift",), "heavy_tails"),
]
"""INDENTER_CASES of them are run, in turn, with new seeds each time round; each is a law that every rival has."""
UNKNOWN = "unknown"


def ours(trials: Path, out: Path) -> Said:
    row = measured.diagnose(trials, out, 1)
    assert not row["error"], row["error"]
    names = tuple(str(m["name"]) for m in row["report"]["mechanisms"])
    if row["report"]["verdict"] != "no_mismatch" and not names:
        names = (UNKNOWN,)
    return Said(names, row["cpu_s"])


def theirs(trials: Path) -> dict[str, Said]:
    began = time.process_time()
    left = [rivals.left_of(read_trial(path)) for path in find_trials([trials])]
    fitting_s = time.process_time() - began
    said = {
        **rivals.by_information(left),
        "Ljung-Box": rivals.by_whiteness(left),
        "pysindy": rivals.by_sparse_regression(left),
    }
    return {name: Said(s.names, s.cpu_s + fitting_s) for name, s in said.items()}


def table_of(specs: list[campaign.Spec], said: list[dict[str, Said]]) -> Table:
    table = Table("method", "false alarms", "detected", "first name right", "named beside it", "s a case")
    for method in said[0]:
        nulls = [s[method] for (_, names, _), s in zip(specs, said, strict=True) if not names]
        effects = [(names[0], s[method]) for (_, names, _), s in zip(specs, said, strict=True) if names]
        first = sum(s.names[:1] == (name,) for name, s in effects)
        beside = sum(len(set(s.names) - {name}) for name, s in effects) / max(len(effects), 1)
        table.add_row(
            method,
            f"{sum(bool(s.names) for s in nulls)} of {len(nulls)}",
            f"{sum(bool(s.names) for _, s in effects)} of {len(effects)}",
            f"{first} of {len(effects)}",
            f"{beside:.1f}",
            f"{sum(s[method].cpu_s for s in said) / len(said):.1f}",
        )
    return table


@pytest.mark.benchmark
@pytest.mark.filterwarnings("default")
def test_side_by_side() -> None:
    n = int(os.environ.get("INDENTER_CASES", str(len(CASES))))
    seed = int(os.environ.get("INDENTER_SEED", "500"))
    specs = [CASES[i % len(CASES)] for i in range(n)]
    said: list[dict[str, Said]] = []
    for i, (kind, names, noise) in enumerate(specs):
        case = draw_case(i, kind, names, noise, "living", seed=seed + i, plans=campaign.plans(seed + i))  # type: ignore[arg-type]
        with tempfile.TemporaryDirectory() as place:
            trials = Path(place) / "trials"
            trials.mkdir()
            campaign.record(case.truth(), trials)
            said.append({"this tool": ours(trials, Path(place) / "out"), **theirs(trials)})
        print(f"\n{names or noise}: { {k: s.names[:3] for k, s in said[-1].items()} }", flush=True)
    Console(width=110).print(table_of(specs, said))
    alarms = sum(
        bool(s["this tool"].names) for (_, names, _), s in zip(specs, said, strict=True) if not names
    )
    assert alarms <= max(1, n // 20)
