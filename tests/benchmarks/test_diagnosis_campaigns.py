"""Campaigns of concealed cases, recorded in memory and scored as `indenter prove` scores its own.

How many cases: INDENTER_CASES (all the campaign asks for, otherwise). Where rows are kept, so that a campaign
that was stopped goes on: INDENTER_CAMPAIGNS (else the temporary folder). INDENTER_PROCESSES at a time (2).
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import pytest
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent))

import campaign

from rig.proof.figures import figures, ladder
from rig.proof.page import is_right
from rig.proof.scores import (
    Outcome,
    all_named,
    all_within,
    first_right,
    is_alarm,
    read_truth,
    right_phase,
    wrong_and_alone,
)

pytestmark = [pytest.mark.slow, pytest.mark.benchmark]

_SAME_AS_A_LAW = {"glue_creep"}
"""A spring beside a dashpot, in series with two arms, is a solid of three arms: no wrong name."""


def opened(name: str, n: int) -> list[Outcome]:
    """Run a campaign, or go on with it; print what failed and every figure."""
    cases = int(os.environ.get("INDENTER_CASES", str(n)))
    folder = Path(
        os.environ.get("INDENTER_CAMPAIGNS", str(Path(tempfile.gettempdir()) / "indenter-campaigns"))
    )
    rows = campaign.run(name, cases, folder, processes=int(os.environ.get("INDENTER_PROCESSES", "2")))
    assert rows
    failed = [r for r in rows if "error" in r]
    outcomes = [Outcome(read_truth(r["truth"]), r["report"]) for r in rows if "error" not in r]
    console = Console(width=140)
    console.print(f"\n{name}: {len(rows)} cases, seconds a case: {_seconds(rows)}")
    for r in failed:
        console.print(f"  case {r['number']}: {r['error']}")
    for o in outcomes:
        if not is_right(o):
            hidden = ", ".join(f"{e.name} at {e.strength:.3g}" for e in o.truth.effects) or o.truth.noise
            said = ", ".join(" or ".join(s) for s in o.named_sets)
            console.print(f"  case {o.truth.number}: {hidden}: {o.verdict} {said}")
    table = Table("figure", "value", "over")
    for f in figures(outcomes):
        table.add_row(f.what, f.value, str(f.over))
    console.print(table)
    assert not failed
    return outcomes


def _seconds(rows: list[campaign.Row]) -> str:
    record, diagnose = (sum(r[k] for r in rows) / len(rows) for k in ("record_s", "diagnose_s"))
    return f"{record:.1f} recorded, {diagnose:.1f} diagnosed"


def share(outcomes: list[Outcome], test: campaign.Callable[[Outcome], bool]) -> float:
    return sum(map(test, outcomes)) / len(outcomes)


def test_nulls() -> None:
    outcomes = opened("nulls", 200)
    by_noise = {noise: [o for o in outcomes if o.truth.noise == noise] for noise in campaign.NOISES}
    for noise, of in by_noise.items():
        print(f"{noise}: {sum(map(is_alarm, of))} false alarms of {len(of)}")
    assert share(outcomes, is_alarm) <= 0.02


def test_ladder_of_single_effects() -> None:
    outcomes = opened("ladder", len(campaign.LIBRARY) * len(campaign.RUNGS))
    table = Table("strength", "cases", "detected", "first name", "within set", "wrong, alone")
    for r in ladder(outcomes):
        table.add_row(*map(str, (r.rung, r.cases, r.detected, r.first, r.within, r.wrong_and_alone)))
    Console(width=140).print(table)
    strong = [o for o in outcomes if o.truth.rung >= 20]
    eight = [o for o in outcomes if o.truth.rung == 8]
    assert share(strong, first_right) >= 0.95
    assert share(strong, all_within) >= 0.98
    assert share(outcomes, wrong_and_alone) <= 0.02
    if eight:
        assert share(eight, first_right) >= 0.85
        assert share(eight, all_within) >= 0.90


def test_usual_sizes_under_every_noise() -> None:
    """Effects as large as benches have them, in noise that is white, correlated, wanders, or scatters the gain."""
    outcomes = opened("usual", len(campaign.LIBRARY) * len(campaign.NOISES))
    for noise in campaign.NOISES:
        of = [o for o in outcomes if o.truth.noise == noise]
        if of:
            print(f"{noise}: first name right in {sum(map(first_right, of))} of {len(of)}")
    assert share(outcomes, all_within) >= 0.9


def test_pairs() -> None:
    assert share(opened("pairs", 60), all_named) >= 0.85


def test_outside_the_library() -> None:
    outcomes = [o for o in opened("outside", 60) if not o.truth.names & _SAME_AS_A_LAW]
    assert share(outcomes, lambda o: o.verdict == "unknown") >= 0.90
    assert share(outcomes, right_phase) >= 0.95


def test_absorbed() -> None:
    """A compliant lever on linear tissue is named or listed as not identifiable, and nothing else is named."""
    assert share(opened("absorbed", 10), is_right) >= 0.9
