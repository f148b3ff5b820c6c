"""The diagnosis beside what a user would try instead, on the same concealed cases."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent))

import campaign
import rivals
from rivals import Said

from analysis.mismatch.diagnosis import diagnose
from analysis.mismatch.intake import Intake, take_in_memory
from sim_hardware.concealment.cases import Case, draw_case

CASES: list[campaign.Spec] = [
    ("null", (), 0.0, "white"),
    ("single", ("viscous_friction",), 50.0, "white"),
    ("null", (), 0.0, "correlated"),
    ("single", ("adhesion",), 50.0, "white"),
    ("null", (), 0.0, "wandering"),
    ("single", ("third_relaxation",), 100.0, "white"),
    ("null", (), 0.0, "gain_jitter"),
    ("single", ("coulomb_friction",), 300.0, "white"),
    ("single", ("heartbeat",), 50.0, "white"),
    ("single", ("stiffening",), 20.0, "white"),
    ("single", ("force_lag",), 100.0, "white"),
    ("single", ("mains_hum",), 50.0, "white"),
]
"""INDENTER_CASES of them are run, in turn, with new seeds each time round."""


def ours(intake: Intake) -> Said:
    from analysis.mismatch.verdict import make_report

    began = time.process_time()
    report = make_report(diagnose(intake, seed=1), baseline="ramp", seed=1, tolerance_mn=0.3)
    names = tuple(m.name for m in report.mechanisms)
    if report.verdict != "no_mismatch" and not names:
        names = ("unknown",)
    return Said(names, time.process_time() - began)


def theirs(intake: Intake) -> dict[str, Said]:
    problem, fit = rivals.baseline(intake)
    said = rivals.by_information(problem, fit)
    return {
        "lmfit, AIC": said["aic"],
        "lmfit, BIC": said["bic"],
        "Ljung-Box": rivals.by_whiteness(problem, fit),
        "pysindy": rivals.by_sparse_regression(problem, fit),
    }


def table_of(cases: list[Case], said: list[dict[str, Said]]) -> Table:
    table = Table(
        "method", "false alarms", "detected", "first name right", "named beside it", "seconds a case"
    )
    for method in said[0]:
        nulls = [s[method] for c, s in zip(cases, said, strict=True) if not c.hidden]
        effects = [(c.hidden[0].name, s[method]) for c, s in zip(cases, said, strict=True) if c.hidden]
        first = sum(s.names[:1] == (name,) for name, s in effects)
        beside = sum(len(set(s.names) - {name}) for name, s in effects) / max(len(effects), 1)
        seconds = sum(s[method].cpu_s for s in said) / len(said)
        table.add_row(
            method,
            f"{sum(bool(s.names) for s in nulls)} of {len(nulls)}",
            f"{sum(bool(s.names) for _, s in effects)} of {len(effects)}",
            f"{first} of {len(effects)}",
            f"{beside:.1f}",
            f"{seconds:.1f}",
        )
    return table


@pytest.mark.benchmark
@pytest.mark.filterwarnings("default")
def test_side_by_side() -> None:
    n = int(os.environ.get("INDENTER_CASES", str(len(CASES))))
    cases: list[Case] = []
    said: list[dict[str, Said]] = []
    for i in range(n):
        kind, names, rung, noise = CASES[i % len(CASES)]
        study = campaign.plans(500 + i)
        case = draw_case(i, kind, names, rung, noise, seed=500 + i, plans=study)  # type: ignore[arg-type]
        intake = take_in_memory(campaign.trials_of(case))
        cases.append(case)
        said.append({"this tool": ours(intake), **theirs(intake)})
        shown: dict[str, Any] = {k: s.names[:3] for k, s in said[-1].items()}
        print(f"\n{names or noise}: {shown}", flush=True)
    Console(width=110).print(table_of(cases, said))
    ours_alarms = sum(bool(s["this tool"].names) for c, s in zip(cases, said, strict=True) if not c.hidden)
    assert ours_alarms <= max(1, n // 20)
