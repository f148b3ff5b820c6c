"""What the diagnosis says of other laboratories' recordings, and whether it is right.

Each is imported and diagnosed as `indenter import` and `indenter diagnose` do it. Single recordings hold no
repeats, so that significance rests on blocks within them: read the figures with that in mind. A page of what was
said and what was expected is written to the folder INDENTER_PAGES (else a temporary one), each report beside it.
"""

from __future__ import annotations

import csv
import json
import os
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from jinja2 import Environment, FileSystemLoader, StrictUndefined

from analysis.mismatch.diagnose import diagnose_paths
from analysis.recordings.importing import import_recordings
from analysis.recordings.trial import Kind

RECORDINGS = Path(__file__).parents[3] / "shared" / "recordings"
PUBLISHED_EMPS = {  # Janot, Gautier, Brunot 2019: 95.1 kg, 203.5 N s/m, 20.4 N
    ("arm_inertia", "mass_g"): 95.1e3,
    ("viscous_friction", "coefficient_mn_s_per_mm"): 203.5,
    ("coulomb_friction", "force_mn"): 20.4e3,
}


@dataclass
class Said:
    """What was said of a recording, what was to be expected, and whether the one is the other."""

    title: str
    expected: str
    report: dict[str, Any]
    right: bool = False


@pytest.fixture(scope="module")
def folder() -> Path:
    """Where the page and the reports go."""
    return Path(os.environ.get("INDENTER_PAGES") or tempfile.mkdtemp(prefix="real-recordings-"))


@pytest.fixture(scope="module")
def everything(folder: Path) -> Iterator[list[Said]]:
    """All that was said; becomes a page in the end."""
    found: list[Said] = []
    yield found
    if found:
        loader = FileSystemLoader(Path(__file__).parent)
        environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined)
        page = folder / "real_recordings.html"
        page.write_text(
            environment.get_template("real_recordings.html.j2").render(all=found), encoding="utf-8"
        )
        print(f"\npage: {page}")


@pytest.fixture
def said(
    request: pytest.FixtureRequest, tmp_path: Path, folder: Path, everything: list[Said]
) -> Iterator[Callable[..., dict[str, Any]]]:
    """Function (title, what is expected, files, kind) -> report; prints what it says."""
    failed, before = request.session.testsfailed, len(everything)

    def diagnosed(title: str, expected: str, files: list[Path], kind: Kind | None = None) -> dict[str, Any]:
        if not all(f.exists() for f in files):
            pytest.skip(f"the recordings are not there: {RECORDINGS}")
        imported, refused = import_recordings(files, tmp_path / title, kind)
        assert not refused
        page = diagnose_paths([one.path for one in imported], out=folder / title)
        report: dict[str, Any] = json.loads((page.parent / "report.json").read_text(encoding="utf-8"))
        everything.append(Said(title, expected, report))
        print(f"\nexpected: {expected}")
        print(f"\n{title}: {report['verdict']}\n  {report['summary']}")
        for m in report["mechanisms"]:
            values = ", ".join(
                f"{n} {q['value']:.4g} +- {q['se']:.2g} {q['unit']}" for n, q in m["parameters"].items()
            )
            print(
                f"  {m['name']}: {values}; or {m['alternatives'] or 'nothing else'}; p = {m['p_value']:.2g}"
            )
        for w in report["mismatch"][:6]:
            print(
                f"  differs in {w['phase']} {w['start_s']:.3f}-{w['stop_s']:.3f} s, {w['share_of_mismatch']:.0%}"
            )
        h = report["heldout"]
        print(
            f"  rms {h['baseline_rms_mn']:.4g} -> {h['improved_rms_mn']:.4g} mN (none held out of few trials)"
        )
        print(f"  {report['explained_share']:.1%} of the mismatch explained")
        return report

    yield diagnosed
    for said_here in everything[before:]:
        said_here.right = request.session.testsfailed == failed


@pytest.mark.benchmark
def test_servo_axis_in_free_travel(said: Callable[..., dict[str, Any]]) -> None:
    expected = "inertia of 95.1 kg, viscous friction of 203.5 N s/m, Coulomb friction of 20.4 N"
    report = said("emps_servo", expected, [RECORDINGS / "emps_servo" / "emps_train.csv"], "air_sweep")
    found = {m["name"]: m["parameters"] for m in report["mechanisms"]}
    for (name, parameter), published in PUBLISHED_EMPS.items():
        assert name in found
        q = found[name][parameter]
        print(f"  {name}: published {published:.4g}, found {q['value']:.4g} +- {q['se']:.2g}")
        assert abs(q["value"] - published) < 3.0 * q["se"]
        assert q["value"] == pytest.approx(published, rel=0.02)
    assert "servo_bandwidth" in found


@pytest.mark.benchmark
def test_cell_relaxation_by_afm(said: Callable[..., dict[str, Any]]) -> None:
    source = RECORDINGS / "afm_relaxation" / "fmt-jpk-sr_cell1-0008.jpk-force"
    report = said("afm_relaxation", "adhesion on the retract (about 1e-4 mN), stiffening", [source])
    assert any(w["phase"] == "retract" for w in report["mismatch"])
    found = {m["name"]: m["parameters"] for m in report["mechanisms"]}
    assert {"adhesion", "stiffening"} <= set(found)
    pull = found["adhesion"]["pull_off_mn"]
    # the recorded force falls to about -1e-4 mN before the cell lets go, little by little, which no law here does
    assert 0.5e-4 < pull["value"] < 2e-4


@pytest.mark.benchmark
def test_lever_indentations(said: Callable[..., dict[str, Any]]) -> None:
    files = [RECORDINGS / "aurora_ddf" / f"relaxation_{n}.ddf" for n in ("10_1", "20_1", "70_1", "100_1")]
    expected = "the lever's ringing and overshoot at its stop, unknown to the library"
    report = said("aurora_ddf", expected, files)
    assert report["verdict"] != "no_mismatch"


@pytest.mark.benchmark
def test_muscle_ramps(said: Callable[..., dict[str, Any]], tmp_path: Path) -> None:
    """Ramps of 0.1 to 100 s, each sampled differently, are diagnosed together."""
    files = []
    for ramp in ("0.1", "1", "10", "100"):
        source = RECORDINGS / "titin_ramps" / f"AvgRelaxed_{ramp}s.csv"
        if not source.exists():
            pytest.skip(f"the recordings are not there: {RECORDINGS}")
        with source.open(encoding="utf-8") as stream:
            rows = list(csv.reader(stream))[1:]
        files.append(tmp_path / f"titin_{ramp}s.csv")
        lines = ["time_s,position_mm,force_mn", *(f"{r[0]},{r[1]},{r[2]}" for r in rows)]
        files[-1].write_text("\n".join(lines) + "\n", encoding="utf-8")
    report = said("titin", "stiffening and a continuous spectrum, more times than two", files)
    print("  notes:", *report["notes"])
    assert report["n_trials"] == len(files)
    assert "stiffening" in _names(report)
    # what stands for a spectrum over a range that four ramps can resolve
    assert {"power_law_relaxation", "third_relaxation", "poroelastic_drainage"} & set(_names(report))


def _names(report: dict[str, Any]) -> list[str]:
    return [m["name"] for m in report["mechanisms"]]
