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

from rig.proof.figures import Figure, by_name, figures
from rig.proof.scores import Outcome, Truth, is_right

HEADER = ("concealed alone", "cases", "detected", "first name", "within set", "wrong, alone", "size held")


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


def print_tables(cases: Sequence[ScoredCase]) -> list[Figure]:
    """Print the figures and the single effects by name; return the figures."""
    console = Console(stderr=True)
    outcomes = [c.outcome for c in cases if c.outcome]
    found = figures(outcomes)
    table = Table("figure", "value", "over", title="Proof")
    for f in found:
        table.add_row(f.what, f.value, str(f.over))
    console.print(table)
    names = by_name(outcomes)
    if names:
        singles = Table(*HEADER)
        for n in names:
            counts = (n.cases, n.detected, n.first, n.within, n.wrong_and_alone)
            singles.add_row(n.name, *map(str, counts), f"{n.covered} of {n.sized}")
        console.print(singles)
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
        names=by_name(outcomes),
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
        "noise": case.truth.noise,
        "skin": case.truth.skin,
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
