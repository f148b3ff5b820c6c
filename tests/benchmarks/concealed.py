"""Score the diagnosis on folders of trials that another program made, and whose truth stands beside them.

    python tests/benchmarks/concealed.py FOLDER --out DIR [--only NAME ...] [--processes 2]

FOLDER holds a folder of trial files a case, and ``truth.json``: by the folder's name its kind (null, single,
pair, outside), the verdicts that are right, and the effects with their parameters. It may say in which phases they show
(``phase``), and what else is there and may be named beside them (``allowed_extra``: a hum, the drive's own servo). One
JSON line a case is kept in DIR/concealed-CODE.jsonl, CODE a digest of the analysis; the same code goes on where it was
stopped.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent))

from measured import Row, code_digest, code_name, diagnose, kept_rows

from rig.proof.figures import figures
from rig.proof.recovery import recoveries
from rig.proof.scores import EXPECTED, NO_MISMATCH, Effect, Outcome, Truth, first_right, is_right


def read_truths(folder: Path) -> dict[str, Mapping[str, Any]]:
    """Return what each case conceals, by the name of its folder."""
    found: dict[str, Mapping[str, Any]] = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    for told in found.values():
        assert tuple(told["expected"]) == EXPECTED.get(told["kind"], ("named", "one_of")), told["expected"]
    return found


def as_truth(number: int, told: Mapping[str, Any]) -> Truth:
    """Return a told truth as the proof scores it; how strong an effect is isn't told, nor, by some, where it shows."""
    effects = tuple(
        Effect(
            str(e["name"]),
            e["stage"] != "outside",
            {k: float(p["value"]) for k, p in e["parameters"].items() if p["value"] is not None},
            tuple(told.get("phase") or ()),
            float("nan"),
        )
        for e in told["effects"]
    )
    noise = ", ".join(f"{k} {v}" for k, v in told["noise"].items())
    skin = "living" if told["scatter"]["tissue_constants"] else "shared"
    return Truth(number, str(told["kind"]), noise, skin, effects, told["mean_tissue"])


def run(
    folder: Path,
    out: Path,
    *,
    only: tuple[str, ...] = (),
    processes: int = 1,
    seed: int = 0,
    listen: Callable[[Row], None] = lambda row: None,
) -> list[Row]:
    """Diagnose every case that this code has not diagnosed yet; return the rows of all asked for, by name."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"concealed-{code_digest()}.jsonl"
    rows: dict[str, Row] = {r["name"]: r for r in kept_rows(path)}
    truths = read_truths(folder)
    wanted = [name for name in truths if not only or name in only]
    with path.open("a") as file, ThreadPoolExecutor(processes) as pool:
        jobs = {
            pool.submit(diagnose, folder / name, out / path.stem / name, seed): name
            for name in wanted
            if name not in rows
        }
        for job in as_completed(jobs):
            name = jobs[job]
            rows[name] = {"name": name, "truth": truths[name], **job.result()}
            file.write(json.dumps(rows[name]) + "\n")
            file.flush()
            listen(rows[name])
    return [rows[name] for name in wanted]


def outcome_of(row: Row) -> Outcome:
    """Return a case with its report, without what is there besides and may be named or not."""
    told, report = row["truth"], row["report"]
    truth = as_truth(0, told)
    beside = frozenset(told.get("allowed_extra") or ()) - truth.names
    mechanisms = [m for m in report["mechanisms"] if m["name"] not in beside]
    # where nothing else was named, nothing was
    only_beside = bool(report["mechanisms"]) and not mechanisms and report["verdict"] != "unknown"
    verdict = NO_MISMATCH if only_beside else report["verdict"]
    return Outcome(truth, {**report, "mechanisms": mechanisms, "verdict": verdict})


def cells(row: Row) -> list[str]:
    """Return a case's row of the table: concealed, said, sizes, right, first, alarm, time."""
    told = row["truth"]
    truth = as_truth(0, told)
    concealed = " + ".join(
        f"{e.name} " + ", ".join(f"{v:.3g}" for v in e.parameters.values()) for e in truth.effects
    )
    cost = f"{row['wall_s']:.0f} ({row['cpu_s']:.0f})"
    if row["error"]:
        return [row["name"], concealed, row["error"], "", "WRONG", cost]
    outcome = outcome_of(row)
    said = " + ".join(" | ".join(s) for s in outcome.named_sets)
    sizes = ", ".join(
        f"{r.parameter} {r.value:.3g}±{r.se:.2g} for {r.truth:.3g}{'' if r.covered else ' (off)'}"
        for r in recoveries(outcome)
    )
    right = "right" if is_right(outcome) else "WRONG"
    if right == "WRONG" and truth.kind == "single" and first_right(outcome):
        right = "WRONG, first name right"
    return [row["name"], concealed or "nothing", f"{outcome.verdict} {said}".strip(), sizes, right, cost]


def score(rows: list[Row]) -> int:
    """Print a row a case, the count, and every figure that they allow; return how many are right."""
    table = Table("case", "concealed", "said", "sizes", "", "s (of processor)")
    lines = [cells(r) for r in rows]
    for line in lines:
        table.add_row(*line)
    console = Console(width=190)
    console.print(table)
    right = sum(line[4] == "right" for line in lines)
    console.print(f"{right} of {len(rows)} right; peak {max(r['peak_mb'] for r in rows):.0f} MB")
    scored = [outcome_of(r) for r in rows if not r["error"]]
    # where effects show is not told by all
    is_told = all(e.phases for o in scored for e in o.truth.effects)
    figure_table = Table("figure", "value", "over")
    for f in figures(scored):
        if is_told or "phase" not in f.what:
            figure_table.add_row(f.what, f.value, str(f.over))
    if figure_table.row_count:
        console.print(figure_table)
    return right


def main() -> int:
    """Score folders from the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", nargs="*", default=[], metavar="NAME")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    print(code_name(), flush=True)
    rows = run(
        given.folder,
        given.out,
        only=tuple(given.only),
        processes=given.processes,
        seed=given.seed,
        listen=lambda row: print(*cells(row), sep="; ", flush=True),
    )
    score(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
