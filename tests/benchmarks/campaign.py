"""Campaigns of concealed cases: draw, record, diagnose, keep one line a case; stopped, they go on.

    python tests/benchmarks/campaign.py singles --skin living --cases 65 --out DIR [--processes 2] [--only 3 7]

With ``--skin drawn`` study, tissue and scatter are others in every case. Seeds are blind: drawn when a campaign
begins and kept in DIR with the truths of its cases, so that another code is judged on the same cases. Rows are
kept by a digest of the analysis, one JSON line a case: the truth, the report, time and memory. Each case is
recorded to files and diagnosed by `indenter diagnose` on them.
"""

from __future__ import annotations

import argparse
import json
import os
import secrets
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from measured import Row, code_digest, code_name, diagnose, digest_of, kept_rows

import sim_hardware
from analysis.recordings import write_trial
from rig.proof.recovery import sizes
from rig.proof.scores import Outcome, is_right, read_truth
from sim_hardware.concealment.cases import NOISES, draw_case, draw_together, outsiders
from sim_hardware.concealment.drawn import drawn_study
from sim_hardware.concealment.knobs import ABSORBED
from sim_hardware.concealment.offline import TrialPlan, record_study, study_plans
from sim_hardware.concealment.sizes import BENCH_SIZES, OTHER_SIZES
from sim_hardware.settings import BenchSettings
from sim_hardware.world.specimens import FINGERS

Spec = tuple[str, tuple[str, ...], str]
"""What to draw: kind, names, noise."""
CAMPAIGNS = ("nulls", "singles", "others", "pairs", "triples", "outside", "absorbed")


def specs(campaign: str, n: int, seed: int, skin: str = "living") -> list[Spec]:
    """Return n cases to draw; every name and every noise comes in its turn."""
    noises = list(NOISES)
    random = np.random.default_rng([seed, 21])
    if campaign == "nulls":
        return [("null", (), noises[i % len(noises)]) for i in range(n)]
    if campaign in ("pairs", "triples"):
        kind = campaign[:-1]
        size = 2 if kind == "pair" else 3
        return [(kind, draw_together(random, size), noises[i % len(noises)]) for i in range(n)]
    names = {
        "singles": list(BENCH_SIZES),
        "others": [n for n in OTHER_SIZES if n not in ABSORBED],
        "outside": outsiders(skin),  # type: ignore[arg-type]
        "absorbed": list(ABSORBED),
    }[campaign]
    kind = {"singles": "single", "others": "single"}.get(campaign, campaign)
    # a name's noise moves on each time round, so that every name has every noise in the end
    turns = [divmod(i, len(names)) for i in range(n)]
    return [(kind, (names[at],), noises[(at + turn) % len(noises)]) for turn, at in turns]


def plans(seed: int, skin: str = "living") -> list[TrialPlan]:
    """Return 20 trials, five fingers at four depths, each at a site of its own, shuffled, rests of 2 to 3 minutes.

    On skin that is drawn for every case the study is drawn too.
    """
    random = np.random.default_rng([seed, 22])
    listed = drawn_study(seed) if skin == "drawn" else study_plans(fingers=FINGERS, repeats=1)
    return [
        replace(listed[i], rest_s=float(random.uniform(120, 180))) for i in random.permutation(len(listed))
    ]


def drawn(number: int, spec: Spec, skin: str, seed: int, kept: Path) -> Row:
    """Draw a case's truth, or take it as it was drawn before: to tell strengths is half the work."""
    kind, names, noise = spec
    if kept.exists():
        truth: Row = json.loads(kept.read_text())
        if (truth["kind"], tuple(h["name"] for h in truth["hidden"]), truth["noise"]) == spec:
            return truth
    case = draw_case(number, kind, names, noise, skin, seed=seed, plans=plans(seed, skin))  # type: ignore[arg-type]
    kept.parent.mkdir(parents=True, exist_ok=True)
    kept.write_text(json.dumps(case.truth()))
    return drawn(number, spec, skin, seed, kept)


def record(truth: Row, folder: Path) -> None:
    """Record a case's study as trial files."""
    path = Path(__file__).parents[1] / "bench_trials.py"
    found = spec_from_file_location("bench_trials", path)
    assert found is not None
    assert found.loader is not None
    module = module_from_spec(found)
    found.loader.exec_module(module)
    settings = BenchSettings.model_validate_json(json.dumps(truth["settings"]))
    for i, recorded in enumerate(record_study(settings, plans(settings.seed, truth["skin"]))):
        write_trial(folder / f"trial_{i + 1:03d}.h5", module.as_trial(recorded))


def run_case(number: int, spec: Spec, skin: str, seed: int, kept: Path) -> Row:
    """Draw, record and diagnose one case."""
    truth = drawn(number, spec, skin, seed, kept)
    with tempfile.TemporaryDirectory(prefix="indenter-case-") as place:
        began = time.monotonic()
        trials = Path(place) / "trials"
        trials.mkdir()
        record(truth, trials)
        recorded = time.monotonic() - began
        measured = diagnose(trials, Path(place) / "diagnosis", seed % 1000)
    return {"number": number, "truth": truth, "record_s": recorded, **measured}


def campaign_seed(name: str, folder: Path, given: int | None) -> int:
    """Return the seed a campaign began with, or a blind one where it begins now."""
    path = folder / f"{name}.seed"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(str(secrets.randbits(31) if given is None else given))
    return int(path.read_text())


def run(
    campaign: str,
    skin: str,
    n: int,
    out: Path,
    *,
    seed: int | None = None,
    processes: int = 1,
    only: frozenset[int] = frozenset(),
    listen: Callable[[Row], None] = lambda row: None,
) -> list[Row]:
    """Run a campaign, or go on with it; return its rows in order. ``only``: these cases (empty: the first n)."""
    name = f"{campaign}-{skin}"
    seed = campaign_seed(name, out, seed)
    path = out / f"{name}-{code_digest()}.jsonl"
    rows = kept_rows(path)
    done = {r["number"] for r in rows}
    kept = out / f"drawn-{digest_of(sim_hardware)}" / name
    listed = specs(campaign, max(n, *only) + 1 if only else n, seed, skin)
    wanted = [i for i in (sorted(only) or range(n)) if i not in done]
    with path.open("a") as file, ThreadPoolExecutor(processes) as pool:

        def begin(i: int) -> Any:
            own = int(np.random.default_rng([seed, 23, i]).integers(2**31))
            return pool.submit(run_case, i, listed[i], skin, own, kept / f"{i}.json")

        for job in as_completed([begin(i) for i in wanted]):
            rows.append(job.result())
            file.write(json.dumps(rows[-1]) + "\n")
            file.flush()
            listen(rows[-1])
    return sorted((r for r in rows if r["number"] in (only or range(n))), key=lambda r: int(r["number"]))


def told(row: Row) -> str:
    """Return a case in one line: number, noise, concealed, said, sizes, right or not, seconds of processor."""
    truth = read_truth(row["truth"])
    hidden = " + ".join(f"{e.name} ({e.strength:.0f})" for e in truth.effects) or "nothing"
    if row["error"]:
        return f"{row['number']}; {truth.noise}; {hidden}; {row['error']}; WRONG"
    outcome = Outcome(truth, row["report"])
    said = " + ".join(" | ".join(s) for s in outcome.named_sets)
    found = ", ".join(
        f"{r.parameter} {r.value:.3g}+-{r.se:.2g} for {r.truth:.3g}{'' if r.covered else ' (off)'}"
        for r in sizes(outcome)
    )
    right = "right" if is_right(outcome) else "WRONG"
    return f"{row['number']}; {truth.noise}; {hidden}; {outcome.verdict} {said}; {found}; {right}; {row['cpu_s']:.0f} s"


def main() -> int:
    """Run a campaign from the command line, a line a case, and its figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("campaign", choices=CAMPAIGNS)
    parser.add_argument("--skin", choices=("living", "shared", "published", "drawn"), default="living")
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--seed", type=int, help="of a campaign that begins; blind where none is given")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="*", default=[], help="numbers of the cases to run")
    given = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    print(code_name(), flush=True)
    rows = run(
        given.campaign,
        given.skin,
        given.cases,
        given.out,
        seed=given.seed,
        processes=given.processes,
        only=frozenset(given.only),
        listen=lambda row: print(told(row), flush=True),
    )
    from rig.proof.figures import figures

    for figure in figures([Outcome(read_truth(r["truth"]), r["report"]) for r in rows if not r["error"]]):
        print(f"{figure.what}: {figure.value} (over {figure.over})")
    return 0


if __name__ == "__main__":
    sys.exit(main())
