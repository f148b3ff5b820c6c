"""What the worker does with trial files, without a window."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.recordings import TrialHeader, TrialWriter, read_trial, write_trial
from analysis.relaxation.fit import fit_trial
from rig.gui.jobs.exporting import bring_in, export_figure, export_fits, export_samples
from rig.gui.jobs.fitting import fit_rows, picture_fit
from rig.gui.jobs.headers import BEING_WRITTEN, keep_index, list_folder, read_headers
from rig.gui.jobs.marking import discard, take_back
from rig.gui.jobs.traces import Axes, read_traces
from rig.gui.jobs.warming import warm_up


@pytest.fixture
def own_study(study_folder: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(study_folder, tmp_path / "own"))


def test_the_index_opens_no_file_twice(own_study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = list_folder(own_study)
    assert len(first.unread) == 6
    headers = read_headers(first.unread)
    assert {(h.finger, h.depth_mm) for h in headers} == {("index", 0.4), ("index", 0.8), ("middle", 0.4)}
    assert all(h.status == "complete" and not h.problem and h.n_samples > 0 for h in headers)
    keep_index(own_study, headers)
    again = list_folder(own_study)
    assert again.known == headers
    assert again.unread == ()
    changed = Path(headers[0].path)
    os.utime(changed, ns=(1, 1))
    assert list_folder(own_study).unread == (str(changed),)


def test_a_damaged_index_is_no_index(own_study: Path) -> None:
    headers = read_headers(list_folder(own_study).unread)
    keep_index(own_study, headers)
    index = next(Path(os.environ["XDG_CACHE_HOME"]).rglob("*.json"))
    for text in ("", "{}", '{"version": 99}', '{"version": 1, "headers": [{"path": 1}]}'):
        index.write_text(text)
        assert len(list_folder(own_study).unread) == 6


def test_unreadable_files_have_a_row_that_says_why(own_study: Path) -> None:
    (own_study / "text.h5").write_text("no HDF5")
    (own_study / "empty.h5").write_bytes(b"")
    (own_study / ".hidden.h5").write_text("")
    problems = {Path(h.path).name: h.problem for h in read_headers(list_folder(own_study).unread)}
    assert "not an HDF5 file" in problems["text.h5"]
    assert "is empty" in problems["empty.h5"]
    assert sum(bool(problem) for problem in problems.values()) == 2
    assert ".hidden.h5" not in problems


@pytest.mark.skipif(os.name == "nt", reason="POSIX locks")
def test_a_file_that_is_written_is_not_read(
    tmp_path: Path, simulated_trial: Callable[..., Any], asked: Callable[..., Any]
) -> None:
    trial = simulated_trial()[0]
    path = tmp_path / "now.h5"
    header = TrialHeader("ramp_hold_retract", "simulated", trial.sample_rate_hz, trial.calibration)
    writer = TrialWriter(path, header, trial.n_samples)
    writer.append(trial.position_v, trial.force_v, trial.command_v)
    assert asked(read_headers, [str(path)])[0].problem == BEING_WRITTEN
    assert "being written" in asked(read_traces, [str(path)], Axes(), 100)[0].problem
    writer.set_phases(list(trial.phases))
    writer.finish("complete")
    assert asked(read_headers, [str(path)])[0].status == "complete"


def test_traces_are_the_recording(study_folder: Path) -> None:
    path = sorted(study_folder.glob("*.h5"))[0]
    trial = read_trial(path)
    (trace,) = read_traces([str(path)], Axes(), 400)
    assert trace.y.max() == np.float32(trial.force_mn.max())
    assert trace.y.min() == np.float32(trial.force_mn.min())
    assert trace.x[-1] == pytest.approx(trial.time_s[-1], rel=0.01)
    (whole,) = read_traces([str(path)], Axes(origin="end of the ramp"), 10**6)
    hold = trial.phase("hold")
    assert hold is not None
    np.testing.assert_allclose(whole.x, trial.time_s - trial.time_s[hold.start], atol=1e-5)
    np.testing.assert_allclose(whole.y, trial.force_mn, rtol=1e-5, atol=1e-4)
    (near,) = read_traces([str(path)], Axes(origin="end of the ramp"), 400, (0.0, 0.01))
    assert near.x.min() >= -1e-6
    assert near.x.max() <= 0.0102
    assert len(near.x) >= 79  # every sample of 10 ms
    (over,) = read_traces([str(path)], Axes("force over position"), 400)
    assert over.x.max() == pytest.approx(trial.position_mm.max(), abs=2e-3)
    (share,) = read_traces([str(path)], Axes(scale="share of the largest"), 400)
    assert share.y.max() == pytest.approx(1.0)
    (per_mm,) = read_traces([str(path)], Axes(scale="per mm of depth"), 400)
    assert per_mm.y.max() == pytest.approx(
        (trial.force_mn.max() - np.median(trial.force_mn[:80])) / 0.4, rel=0.02
    )


def test_one_file_that_cant_be_drawn_leaves_the_others(study_folder: Path, tmp_path: Path) -> None:
    bad = tmp_path / "bad.h5"
    bad.write_bytes(sorted(study_folder.glob("*.h5"))[0].read_bytes()[:-40_000])
    traces = read_traces([str(bad), str(sorted(study_folder.glob("*.h5"))[1])], Axes(), 100)
    assert traces[0].problem.startswith(str(bad))
    assert len(traces[1].x) > 100


def test_a_fit_picture_is_the_fit(study_folder: Path) -> None:
    path = sorted(study_folder.glob("*.h5"))[0]
    picture = picture_fit(str(path), "ramp", 300)
    assert picture.row.estimates == fit_trial(read_trial(path)).estimates
    assert len(picture.recorded[0]) <= 604
    assert np.abs(picture.means[1]).max() < np.abs(picture.residual[1]).max()
    assert np.interp(1.0, *picture.fitted) == pytest.approx(np.interp(1.0, *picture.recorded), abs=1.5)
    step = picture_fit(str(path), "step", 300)
    assert step.fitted[0].min() >= 0.0
    assert np.all(np.isfinite(step.residual))


def test_a_trial_without_a_fit_has_its_reason(tmp_path: Path, simulated_trial: Callable[..., Any]) -> None:
    from dataclasses import replace

    path = tmp_path / "sweep.h5"
    trial = replace(simulated_trial()[0], kind="air_sweep")
    write_trial(path, trial)
    picture = picture_fit(str(path), "ramp", 300)
    assert "air sweep" in picture.row.failure
    assert picture.fitted.shape == (2, 0)
    assert picture.recorded[1].max() == trial.force_mn.max()


def test_samples_leave_and_come_back(study_folder: Path, tmp_path: Path) -> None:
    path = sorted(study_folder.glob("*.h5"))[0]
    (written,) = export_samples([str(path)], tmp_path / "csv")
    (back,) = bring_in(Path(written), tmp_path / "back")
    trial, again = read_trial(path), read_trial(Path(back))
    np.testing.assert_allclose(again.force_mn, trial.force_mn, atol=1e-6)
    np.testing.assert_allclose(again.position_mm, trial.position_mm, atol=1e-6)
    assert bring_in(Path(written), tmp_path / "back") == (back,)  # brought in before: kept as it is
    other = tmp_path / "other" / Path(written).name
    other.parent.mkdir()
    lines = Path(written).read_text().splitlines()
    other.write_text("\n".join(lines[:-100]))
    with pytest.raises(BadInputError, match="another recording of this name: rename one"):
        bring_in(other, tmp_path / "back")


def test_fits_and_figures_are_written(study_folder: Path, tmp_path: Path) -> None:
    paths = [str(path) for path in sorted(study_folder.glob("*.h5"))[:2]]
    lines = Path(export_fits(paths, "ramp", tmp_path)).read_text().splitlines()
    assert len(lines) == 3
    assert lines[0].startswith("file,trial_id,finger,depth_mm")
    figure = Path(export_figure(paths, ("a", "b"), Axes(), tmp_path, "overlay"))
    assert figure.stat().st_size > 10_000
    assert figure.with_suffix(".pdf").exists()
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInputError, match="can't be written"):
        export_fits(paths, "ramp", tmp_path / "file" / "deeper")


def test_discarding_needs_a_reason_and_can_be_taken_back(own_study: Path) -> None:
    path = str(sorted(own_study.glob("*.h5"))[0])
    before = read_trial(Path(path))
    with pytest.raises(BadInputError, match="reason"):
        discard([path], "  ")
    assert discard([path], "the finger moved")[0].discarded == "the finger moved"
    assert fit_rows([path], "ramp")[0].discarded == "the finger moved"
    assert take_back([path])[0].discarded == ""
    after = read_trial(Path(path))
    np.testing.assert_array_equal(before.force_v, after.force_v)
    assert after.trial_id == before.trial_id


def test_warming_up_fits() -> None:
    assert warm_up() == pytest.approx(120.0 * 0.45, rel=0.1)
