"""Campaigns of concealed cases in memory: draw, record, diagnose, keep one line a case; stopped, they go on.

    python tests/benchmarks/campaign.py ladder --cases 46 --out DIR [--processes 2] [--seed 1]

Each line of DIR/NAME.jsonl holds the truth, the report, and what it took. DIR/drawn keeps the cases, so
that the same ones can be diagnosed again once the lines are removed. The tests beside this file run
campaigns and print their tables with `rig.proof.scores`.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np

import sim_hardware
from sim_hardware.concealment.cases import NOISES, RUNGS, Case, Hidden, draw_case, draw_pair
from sim_hardware.concealment.knobs import ABSORBED, LIBRARY, OUTSIDE
from sim_hardware.concealment.offline import TrialPlan, record_study, study_plans
from sim_hardware.settings import BenchSettings

Row = dict[str, Any]
Spec = tuple[str, tuple[str, ...], float, str]


def specs(campaign: str, n: int, seed: int) -> list[Spec]:
    """Return what to draw: kind, names, rung, noise, n of them; every name and rung comes in its turn."""
    random = np.random.default_rng([seed, 21])
    library, outside = list(LIBRARY), list(OUTSIDE)
    if campaign == "nulls":
        return [("null", (), 0.0, list(NOISES)[i % 4]) for i in range(n)]
    if campaign == "ladder":
        rungs = [20.0, 300.0, 8.0, 100.0, 50.0, 1000.0, 12.0, 5.0, 3.0]
        every = [("single", (name,), rung, "white") for rung in rungs for name in library]
        return [every[i % len(every)] for i in range(n)]
    if campaign == "usual":
        every = [("single", (name,), 0.0, noise) for noise in NOISES for name in library]
        return [every[i % len(every)] for i in range(n)]
    if campaign == "outside":
        rungs = [100.0, 20.0, 300.0, 50.0, 1000.0]
        every = [("outside", (name,), rung, "white") for rung in rungs for name in outside]
        return [every[i % len(every)] for i in range(n)]
    if campaign == "absorbed":
        return [("absorbed", tuple(ABSORBED), 0.0, "white") for _ in range(n)]
    if campaign == "pairs":
        found: list[Spec] = []
        for i in range(n):
            found.append(("pair", draw_pair(random), RUNGS[4 + i % 4], "white"))
        return found
    raise ValueError(f"no campaign {campaign!r}")


def plans(seed: int) -> list[TrialPlan]:
    """Return 20 trials at 4 depths in shuffled order, with rests of 2 to 3 minutes."""
    random = np.random.default_rng([seed, 22])
    listed = study_plans()
    order = random.permutation(len(listed))
    return [replace(listed[i], rest_s=float(random.uniform(120, 180))) for i in order]


def trials_of(case: Case) -> list[Any]:
    """Record a case's study in memory."""
    path = Path(__file__).parents[1] / "bench_trials.py"
    spec = spec_from_file_location("bench_trials", path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return [module.as_trial(r) for r in record_study(case.settings, plans(case.settings.seed))]


def drawn(number: int, spec: Spec, seed: int, kept: Path) -> Case:
    """Draw a case, or take it as it was drawn before: to scale its effects is half the work."""
    if kept.exists():
        truth = json.loads(kept.read_text())
        hidden = tuple(Hidden(**{**h, "phases": tuple(h["phases"])}) for h in truth["hidden"])
        settings = BenchSettings.model_validate_json(json.dumps(truth["settings"]))
        return Case(number, truth["kind"], truth["rung"], truth["noise"], settings, hidden)
    kind, names, rung, noise = spec
    case = draw_case(number, kind, names, rung, noise, seed=seed, plans=plans(seed))  # type: ignore[arg-type]
    kept.parent.mkdir(parents=True, exist_ok=True)
    kept.write_text(json.dumps(case.truth()))
    return case


def bench_digest() -> str:
    """Return a digest of the bench's sources: cases drawn on another bench have other strengths on this one."""
    folder = Path(sim_hardware.__file__).parent
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:8]


def run_case(number: int, spec: Spec, seed: int, kept: Path) -> Row:
    """Draw, record and diagnose one case."""
    from analysis.mismatch.diagnosis import diagnose
    from analysis.mismatch.intake import take_in_memory

    case = drawn(number, spec, seed, kept)
    started = time.monotonic()
    trials = trials_of(case)
    recorded = time.monotonic()
    row: Row = {"number": number, "truth": case.truth()}
    try:
        diagnosis = diagnose(take_in_memory(trials), seed=seed % 1000)
        row["report"] = as_report(diagnosis, seed % 1000)
        row["steps"] = steps_of(diagnosis)
    except Exception as error:  # noqa: BLE001 - a campaign outlives a case that fails, and counts it
        row["error"] = f"{type(error).__name__}: {error}"
    row["record_s"] = recorded - started
    row["diagnose_s"] = time.monotonic() - recorded
    return row


def as_report(diagnosis: Any, seed: int) -> Row:
    """Return what report.json would say, without the protocol to run next."""
    from analysis.mismatch.verdict import make_report

    report: Row = make_report(diagnosis, baseline="ramp", seed=seed, tolerance_mn=0.3).as_json()
    return report


def steps_of(diagnosis: Any) -> list[Row]:
    """Return what was considered at each step: names, gains, p-values."""
    named = diagnosis.named
    found = []
    for i, considered in enumerate(named.considered):
        energy = float(diagnosis.problem.repeatable(named.fits[min(i, len(named.fits) - 1)]).sum())
        found.append(
            {
                "left": energy,
                "considered": [[c.mechanism.name, c.total_gain, c.p_value] for c in considered[:6]],
            }
        )
    return found


def run(
    campaign: str,
    n: int,
    out: Path,
    *,
    seed: int = 1,
    processes: int = 1,
    only: frozenset[int] = frozenset(),
    listen: Callable[[Row], None] | None = None,
) -> list[Row]:
    """Run a campaign, or go on with it; return all its rows in order. ``only``: these cases (empty: all)."""
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"{campaign}-{seed}.jsonl"
    rows = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    done = {r["number"] for r in rows}
    wanted = [
        (i, s) for i, s in enumerate(specs(campaign, n, seed)) if i not in done and (not only or i in only)
    ]
    with path.open("a") as file:
        for row in _done(wanted, seed, processes, out / f"drawn-{bench_digest()}" / f"{campaign}-{seed}"):
            file.write(json.dumps(row) + "\n")
            file.flush()
            rows.append(row)
            if listen:
                listen(row)
    return sorted((r for r in rows if r["number"] < n), key=lambda r: int(r["number"]))


def _done(wanted: list[tuple[int, Spec]], seed: int, processes: int, kept: Path) -> Iterable[Row]:
    def seed_of(i: int) -> int:
        return int(np.random.default_rng([seed, 23, i]).integers(2**31))

    if processes == 1:
        yield from (run_case(i, s, seed_of(i), kept / f"{i}.json") for i, s in wanted)
        return
    with ProcessPoolExecutor(processes) as pool:
        jobs = [pool.submit(run_case, i, s, seed_of(i), kept / f"{i}.json") for i, s in wanted]
        for job in as_completed(jobs):
            yield job.result()


def main() -> int:
    """Run a campaign from the command line, a line a case."""
    parser = argparse.ArgumentParser()
    parser.add_argument("campaign")
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="*", default=[], help="numbers of the cases to run")
    given = parser.parse_args()

    def tell(row: Row) -> None:
        hidden = [(h["name"], round(h["strength"], 1)) for h in row["truth"]["hidden"]]
        report = row.get("report", {})
        said = [(m["name"], m["alternatives"]) for m in report.get("mechanisms", [])]
        print(
            row["number"],
            hidden,
            report.get("verdict", row.get("error")),
            said,
            f"{row['diagnose_s']:.0f} s",
            flush=True,
        )

    run(
        given.campaign,
        given.cases,
        given.out,
        seed=given.seed,
        processes=given.processes,
        only=frozenset(given.only),
        listen=tell,
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
