"""From files to the study's table and page: every file a row, on whatever executor."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from analysis.errors import BadInputError
from analysis.recordings import write_trial
from analysis.recordings.trial import Trial
from analysis.relaxation.batch import fit_files, fit_paths
from analysis.relaxation.tables import COLUMNS

HEADER = (
    "file,trial_id,finger,depth_mm,repeat,model,n_samples,A0_mn,A0_mn_se,A1_over_A0,A1_over_A0_se,A2_over_A0,"
    "A2_over_A0_se,t1_s,t1_s_se,t2_s,t2_s_se,stiffness_mn_per_um,rms_mn,r2,flags"
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, simulate: Callable[..., Trial]) -> Path:
    """Eight good trials of two fingers, a discarded one, an air sweep, a cut file and a text file."""
    made = tmp_path_factory.mktemp("study")
    number = 0
    for finger in ("thumb", "index"):
        for depth in (0.2, 0.6):
            for repeat in (1, 2):
                k0 = 120.0 if finger == "index" else 100.0
                trial = simulate(
                    depth, seed=number, finger=finger, repeat=repeat, k0=k0, hold_s=3.0, dwell_s=0.5
                )
                write_trial(made / f"{finger}_{depth}_{repeat}.h5", trial)
                number += 1
    discarded = replace(simulate(0.2, seed=50, hold_s=3.0, dwell_s=0.5), discarded="finger moved")
    write_trial(made / "z_discarded.h5", discarded)
    sweep = replace(trial, kind="air_sweep", phases=(replace(trial.phases[0], name="sweep"),))
    write_trial(made / "z_sweep.h5", sweep)
    whole = (made / "thumb_0.2_1.h5").read_bytes()
    (made / "z_cut.h5").write_bytes(whole[: len(whole) // 2])
    (made / "z_text.h5").write_text("time_s,force_mn\n")
    return made


@pytest.fixture(scope="module")
def written(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("out")
    assert fit_paths([folder], out=out, jobs=1) == out / "fits.html"
    return out


def rows_of(path: Path) -> dict[str, dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return {row["file"]: row for row in csv.DictReader(file)}


def test_csv_is_the_contract(written: Path):
    lines = (written / "fits.csv").read_text().splitlines()
    assert lines[0] == ",".join(COLUMNS)
    assert lines[0].startswith(HEADER + ",")
    rows = rows_of(written / "fits.csv")
    assert len(rows) == 12
    good = rows["index_0.6_1.h5"]
    assert (good["finger"], good["depth_mm"], good["repeat"], good["model"]) == ("index", "0.6", "1", "ramp")
    assert float(good["stiffness_mn_per_um"]) == pytest.approx(0.12, rel=0.01)
    assert float(good["t1_s"]) > float(good["t2_s"])
    assert good["flags"] == ""


@pytest.mark.parametrize(
    ("file", "reason"),
    [
        ("z_sweep.h5", "air sweep"),
        ("z_cut.h5", "cut short"),
        ("z_text.h5", "not an HDF5 file"),
    ],
)
def test_unfitted_trials_keep_their_row(written: Path, file: str, reason: str):
    row = rows_of(written / "fits.csv")[file]
    assert reason in row["flags"]
    assert "\n" not in row["flags"]
    assert row["A0_mn"] == row["t1_s_se"] == row["r2"] == ""


def test_discarded_trials_have_a_row_and_no_place_in_the_table(written: Path):
    assert rows_of(written / "fits.csv")["z_discarded.h5"]["flags"].startswith("discarded: finger moved")
    document = json.loads((written / "fits.json").read_text())
    assert document["study"]["n_used"] == 8
    assert document["study"]["n_rows"] == 12
    groups = {(g["finger"], g["depth_mm"]): g["columns"] for g in document["study"]["groups"]}
    assert groups["thumb", 0.2]["t1_s"]["n"] == 2
    assert groups[None, None]["t1_s"]["n"] == 8
    assert document["published"]["t1_s"] == {"mean": 2.279, "sd": 0.233}


def test_between_and_within_finger_variance(written: Path):
    scatter = json.loads((written / "fits.json").read_text())["study"]["scatter"]
    stiffness = next(s for s in scatter if s["depth_mm"] == 0.6)["columns"]["stiffness_mn_per_um"]
    # 100 and 120 mN/mm: between them a standard deviation of 0.0141 mN/um, repeats differ far less
    assert stiffness["between"] ** 0.5 == pytest.approx(0.01414, rel=0.02)
    assert stiffness["within"] ** 0.5 < 1e-3


def test_page_holds_all_it_shows(written: Path):
    page = (written / "fits.html").read_text(encoding="utf-8")
    sources = re.findall(r'(?:src|href)="([^"]{0,30})', page)
    assert len(sources) == 3
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert "z_cut.h5" in page
    assert "2.279" in page
    for name in ("relaxation", "stiffness", "parameters"):
        pdf = (written / f"{name}.pdf").read_bytes()
        assert b"/FontType 42" in pdf or b"/CIDFontType2" in pdf
        assert b"/Type3" not in pdf
        assert (written / f"{name}.png").stat().st_size > 5000


def test_step_model_writes_the_same_columns(folder: Path, tmp_path: Path):
    fit_paths([folder / "index_0.6_1.h5"], model="step", out=tmp_path / "new", jobs=1)
    (row,) = rows_of(tmp_path / "new" / "fits.csv").values()
    assert row["model"] == "step"
    assert float(row["n_samples"]) == 24000


def test_intervals_and_one_solid_a_finger_on_request(folder: Path, tmp_path: Path):
    files = [folder / f"{name}.h5" for name in ("index_0.2_1", "index_0.6_1", "thumb_0.6_1")]
    fit_paths(files, out=tmp_path, jobs=1, intervals=True, joint=True)
    document = json.loads((tmp_path / "fits.json").read_text())
    for trial in document["trials"]:
        interval, estimate = trial["intervals_95"]["t1_s"], trial["t1_s"]
        assert interval["high"] - interval["low"] == pytest.approx(2 * 1.96 * estimate["se"], rel=0.1)
    index, thumb = document["joint"]
    assert (index["finger"], index["n"]) == ("index", 2)
    assert index["estimates"]["k0_mn_per_mm"]["value"] == pytest.approx(120.0, rel=0.01)
    assert index["estimates"]["t1_s"]["se"] < document["trials"][0]["t1_s"]["se"]
    assert thumb["estimates"] is None
    assert "two trials" in thumb["failure"]
    page = (tmp_path / "fits.html").read_text(encoding="utf-8")
    assert "One solid for all trials of a finger" in page
    assert "Profile intervals" in page
    with pytest.raises(BadInputError, match="--model ramp"):
        fit_paths(files, model="step", out=tmp_path, jobs=1, joint=True)


def test_any_executor_gives_the_same_rows_in_order(folder: Path):
    files = sorted(folder.glob("*.h5"))
    alone = fit_files(files, "ramp")
    counted: list[int] = []
    with ThreadPoolExecutor(2) as executor:
        pooled = fit_files(files, "ramp", executor, counted.append)
    assert [row.file for row in pooled] == [path.name for path in files]
    assert [row.flags for row in pooled] == [row.flags for row in alone]
    assert [row.estimates for row in pooled] == [row.estimates for row in alone]
    assert sum(counted) == len(files)


def test_processes_give_the_same_table(folder: Path, written: Path, tmp_path: Path):
    fit_paths([folder], out=tmp_path, jobs=2)
    assert (tmp_path / "fits.csv").read_text() == (written / "fits.csv").read_text()


@pytest.mark.filterwarnings("default")
def test_dask_cluster_gives_the_same_table(folder: Path, written: Path, tmp_path: Path):
    distributed = pytest.importorskip("distributed", reason="the optional extra dask is not installed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None
    ) as cluster:
        fit_paths([folder], out=tmp_path, dask=cluster.scheduler_address)
    assert (tmp_path / "fits.csv").read_text() == (written / "fits.csv").read_text()


class DyingExecutor(ThreadPoolExecutor):
    """An executor whose processes die at work."""

    def submit(self, *_: object, **__: object) -> Future[object]:
        failed: Future[object] = Future()
        failed.set_exception(BrokenExecutor("a process died"))
        return failed


def test_a_dead_worker_is_one_line_that_names_a_file(folder: Path):
    with DyingExecutor(1) as executor, pytest.raises(BadInputError, match=r"index_0.2_1.h5: .*died"):
        fit_files([folder / "index_0.2_1.h5"], "ramp", executor)


def test_results_that_cannot_be_written_are_one_line(folder: Path, tmp_path: Path):
    (tmp_path / "fits.csv").mkdir()
    with pytest.raises(BadInputError, match="can't be written"):
        fit_paths([folder / "index_0.2_1.h5"], out=tmp_path, jobs=1)


def test_files_of_one_name_are_told_apart(folder: Path, tmp_path: Path):
    for place in ("a", "b"):
        (tmp_path / place).mkdir()
        (tmp_path / place / "t.h5").write_bytes((folder / "index_0.2_1.h5").read_bytes())
    fit_paths([tmp_path / "a", tmp_path / "b"], out=tmp_path / "out", jobs=1)
    assert set(rows_of(tmp_path / "out" / "fits.csv")) == {"a/t.h5", "b/t.h5"}


def test_wrong_use_is_one_line(folder: Path, tmp_path: Path):
    unreadable = [folder / "z_text.h5", folder / "z_cut.h5"]
    (tmp_path / "file").write_text("")
    cases = [
        lambda: fit_paths(unreadable, out=tmp_path / "o"),
        lambda: fit_paths([tmp_path / "none"], out=tmp_path / "o"),
        lambda: fit_paths([folder], model="stretched", out=tmp_path / "o"),
        lambda: fit_paths([folder], out=tmp_path / "o", jobs=0),
        lambda: fit_paths([folder / "z_sweep.h5"], out=tmp_path / "file" / "o"),
        lambda: fit_paths([folder / "z_sweep.h5"], out=tmp_path / "o", dask="not an address"),
    ]
    for case in cases:
        with pytest.raises(BadInputError) as caught:
            case()
        assert "\n" not in str(caught.value)
    fit_paths([folder / "z_sweep.h5"], out=tmp_path / "nothing_fitted", jobs=1)
    assert "air sweep" in (tmp_path / "nothing_fitted" / "fits.html").read_text()
