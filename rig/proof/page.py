"""What a proof shows: tables in the terminal, and one page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from rig.proof.figures import Figure, figures, ladder
from rig.proof.scores import NO_MISMATCH, Outcome, Truth, all_named, all_within, spurious

_UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class ScoredCase:
    """One case opened: its truth, the report on it (None where ``failure`` says why), its seal and salt."""

    truth: Truth
    report: Mapping[str, Any] | None
    failure: str
    record_s: float
    diagnose_s: float
    seal: str
    salt: str

    @property
    def outcome(self) -> Outcome | None:
        """Truth and report together; None where there is no report."""
        return None if self.report is None else Outcome(self.truth, self.report)

    @property
    def right(self) -> bool:
        """Whether it came out as it should."""
        return self.outcome is not None and is_right(self.outcome)


def is_right(outcome: Outcome) -> bool:
    """Whether a case came out as it should: nothing named where nothing is, the right thing where it is."""
    kind = outcome.truth.kind
    if kind == "null":
        return outcome.verdict == NO_MISMATCH
    if kind == "outside":
        return outcome.verdict == _UNKNOWN
    if kind == "absorbed":
        return all_within(outcome) or not outcome.named_sets
    if kind == "pair":
        return all_named(outcome) and not spurious(outcome)
    return all_within(outcome) and not spurious(outcome)


def print_tables(cases: Sequence[ScoredCase]) -> list[Figure]:
    """Print the figures and the ladder of strengths; return the figures."""
    console = Console(stderr=True)
    outcomes = [c.outcome for c in cases if c.outcome]
    found = figures(outcomes)
    table = Table("figure", "value", "over", title="Proof")
    for f in found:
        table.add_row(f.what, f.value, str(f.over))
    console.print(table)
    rungs = ladder(outcomes)
    if rungs:
        steps = Table("strength", "cases", "detected", "first name", "within set", "wrong, alone")
        for r in rungs:
            counts = (r.cases, r.detected, r.first, r.within, r.wrong_and_alone)
            steps.add_row(f"{r.rung:g}", *map(str, counts))
        console.print(steps)
    for case in cases:
        if case.failure:
            console.print(
                f"case {case.truth.number}: {case.failure}", style="red", highlight=False, soft_wrap=True
            )
    return found


def write_page(out: Path, cases: Sequence[ScoredCase], *, seed: int, trials: int) -> Path:
    """Write ``proof.html`` into ``out`` and return its path; ``trials``: how many a case has."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    outcomes = [c.outcome for c in cases if c.outcome]
    environment = Environment(
        loader=PackageLoader("rig.proof", "."), autoescape=True, undefined=StrictUndefined
    )
    html = environment.get_template("page.html.j2").render(
        figures=figures(outcomes),
        rungs=ladder(outcomes),
        cases=[_cells(c) for c in cases],
        seed=seed,
        trials=trials,
        date=datetime.now().astimezone().strftime("%Y-%m-%d"),
        version=version("indenter"),
    )
    path = out / "proof.html"
    path.write_text(html, encoding="utf-8")
    return path


def case_data(case: ScoredCase) -> dict[str, Any]:
    """Return a case as the proof's JSON file holds it."""
    report = case.report
    return {
        "number": case.truth.number,
        "seal": case.seal,
        "kind": case.truth.kind,
        "rung": case.truth.rung,
        "concealed": {e.name: e.strength for e in case.truth.effects},
        "verdict": report["verdict"] if report else None,
        "named": [list(s) for s in case.outcome.named_sets] if case.outcome else [],
        "right": case.right,
        "failure": case.failure,
        "record_s": case.record_s,
        "diagnose_s": case.diagnose_s,
    }


def _cells(case: ScoredCase) -> dict[str, Any]:
    concealed = ", ".join(f"{e.name} (strength {e.strength:.3g})" for e in case.truth.effects)
    said, link = case.failure, ""
    if case.outcome:
        names = ", ".join(" or ".join(s) for s in case.outcome.named_sets)
        said = f"{case.outcome.verdict}: {names}" if names else case.outcome.verdict
        link = f"case_{case.truth.number:03d}/diagnosis/report.html"
    return {
        "number": case.truth.number,
        "concealed": concealed or f"nothing, {case.truth.noise.replace('_', ' ')} noise",
        "said": said,
        "link": link,
        "right": case.right,
        "record_s": f"{case.record_s:.0f}",
        "diagnose_s": f"{case.diagnose_s:.0f}",
        "seal": case.seal,
        "salt": case.salt,
    }
