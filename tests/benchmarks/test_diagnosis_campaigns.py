"""Campaigns of concealed cases on living skin and on shared tissue, and folders by another hand: rates that must hold.

How many cases: INDENTER_CASES (all the campaign asks for, otherwise). Where rows are kept, so that a campaign
that was stopped goes on: INDENTER_CAMPAIGNS (else the temporary folder). INDENTER_PROCESSES at a time (2).
Folders of another program: INDENTER_CONCEALED (else where recordings of others are; skipped where there are none).
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
import concealed

from rig.proof.figures import by_name, figures
from rig.proof.page import HEADER
from rig.proof.probability import expected_calibration_error, set_size, statements
from rig.proof.recovery import sizes
from rig.proof.scores import (
    Outcome,
    all_within,
    first_right,
    is_alarm,
    is_right,
    read_truth,
    right_phase,
    wrong_and_alone,
    wrong_library_name,
)

pytestmark = [pytest.mark.slow, pytest.mark.benchmark]

SKINS = ("living", "shared")
PROCESSES = int(os.environ.get("INDENTER_PROCESSES", "2"))
RECORDINGS = Path(__file__).parents[3] / "shared" / "recordings"


def kept() -> Path:
    return Path(os.environ.get("INDENTER_CAMPAIGNS", str(Path(tempfile.gettempdir()) / "indenter-campaigns")))


def opened(name: str, skin: str, n: int) -> list[Outcome]:
    """Run a campaign, or go on with it; print what was wrong and every figure."""
    cases = int(os.environ.get("INDENTER_CASES", str(n)))
    rows = campaign.run(name, skin, cases, kept(), processes=PROCESSES)
    assert rows
    failed = [r for r in rows if r["error"]]
    outcomes = [Outcome(read_truth(r["truth"]), r["report"]) for r in rows if not r["error"]]
    console = Console(width=160)
    seconds, peak_mb = sum(r["cpu_s"] for r in rows) / len(rows), max(r["peak_mb"] for r in rows)
    console.print(
        f"\n{name} on {skin} skin: {len(rows)} cases, {seconds:.0f} s of processor each, {peak_mb:.0f} MB at most"
    )
    for row in rows:
        if row["error"] or not is_right(Outcome(read_truth(row["truth"]), row["report"])):
            console.print(f"  {campaign.told(row)}")
    table = Table("figure", "value", "over")
    for f in figures(outcomes):
        table.add_row(f.what, f.value, str(f.over))
    console.print(table)
    names = Table(*HEADER)
    for b in by_name(outcomes):
        counts = map(str, (b.cases, b.detected, b.first, b.within, b.wrong_and_alone))
        names.add_row(b.name, *counts, f"{b.covered} of {b.sized}")
    if names.row_count:
        console.print(names)
    assert not failed
    return outcomes


def share(outcomes: list[Outcome], test: campaign.Callable[[Outcome], bool]) -> float:
    return sum(map(test, outcomes)) / len(outcomes)


@pytest.mark.parametrize("skin", SKINS)
def test_nulls(skin: str) -> None:
    outcomes = opened("nulls", skin, 200)
    for noise in campaign.NOISES:
        of = [o for o in outcomes if o.truth.noise == noise]
        print(f"{noise}: {sum(map(is_alarm, of))} false alarms of {len(of)}")
    assert share(outcomes, is_alarm) <= 0.02


@pytest.mark.parametrize("skin", SKINS)
def test_single_effects_of_a_bench_s_size(skin: str) -> None:
    outcomes = opened("singles", skin, 6 * len(campaign.BENCH_SIZES))
    held = [r.covered for o in outcomes for r in sizes(o)]
    assert share(outcomes, first_right) >= 0.90
    assert share(outcomes, all_within) >= 0.97
    assert share(outcomes, wrong_and_alone) <= 0.02
    assert sum(held) / len(held) >= 0.85


@pytest.mark.parametrize("skin", SKINS)
def test_the_library_s_others(skin: str) -> None:
    outcomes = opened("others", skin, 18)
    assert share(outcomes, all_within) >= 0.9


@pytest.mark.parametrize("skin", SKINS)
def test_three_at_once(skin: str) -> None:
    assert share(opened("triples", skin, 40), is_right) >= 0.75


@pytest.mark.parametrize("skin", SKINS)
def test_outside_the_library(skin: str) -> None:
    outcomes = opened("outside", skin, 40)
    assert share(outcomes, lambda o: o.verdict == "unknown") >= 0.80
    assert share(outcomes, right_phase) >= 0.90
    assert share(outcomes, wrong_library_name) <= 0.10


@pytest.mark.parametrize("skin", SKINS)
def test_absorbed(skin: str) -> None:
    """A compliant lever on linear tissue is named or listed as not identifiable, and nothing else is named."""
    assert share(opened("absorbed", skin, 10), is_right) >= 0.9


def test_probabilities_of_all_campaigns_together() -> None:
    """Of every row that is kept of this code: what the other campaigns ran."""
    rows = [r for path in kept().glob(f"*-{campaign.code_digest()}.jsonl") for r in campaign.kept_rows(path)]
    rows = [r for r in rows if not r["error"] and "number" in r]
    said = [s for r in rows for s in statements(Outcome(read_truth(r["truth"]), r["report"]))]
    if not said:
        pytest.skip("no campaign of this code was run yet, or its reports give no probabilities")
    error, held = expected_calibration_error(said), sum(s.held for s in said) / len(said)
    print(f"\n{len(said)} statements of {len(rows)} cases: expected calibration error {error:.3f}, ", end="")
    print(f"90 % sets hold the truth in {held:.1%} with {set_size(said):.2f} names")
    assert error <= 0.05
    assert 0.85 <= held <= 0.97
    assert set_size(said) <= 1.5


def test_folders_by_another_hand() -> None:
    folder = Path(os.environ.get("INDENTER_CONCEALED", str(RECORDINGS / "concealed")))
    if not (folder / "truth.json").exists():
        pytest.skip(f"{folder}: no folders by another hand")
    rows = concealed.run(folder, kept(), processes=PROCESSES)
    assert concealed.score(rows) >= round(15 / 17 * len(rows))
