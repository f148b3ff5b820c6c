"""The page of fits for any experiment: in a real browser nothing is cut off, and no figure is empty."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.recordings import write_trial
from analysis.recordings.importing import import_recordings
from analysis.recordings.trial import Trial
from analysis.relaxation.batch import fit_paths

RECORDINGS = Path(__file__).parents[3].parent / "shared" / "recordings"


class Fitted:
    """Pages of fits, made once a kind, their figures' texts looked at while they are drawn."""

    def __init__(self, folder: Path, watched_figures: Callable[[], AbstractContextManager[Any]]) -> None:
        self.folder = folder
        self.watched_figures = watched_figures
        self.pages: dict[str, Path] = {}
        self.faults: dict[str, list[str]] = {}

    def page(self, kind: str, trials: Path) -> Path:
        """Return the page of a folder of trials."""
        if kind not in self.pages:
            with self.watched_figures() as faults:
                self.pages[kind] = fit_paths([trials], out=self.folder / kind, jobs=1)
            self.faults[kind] = faults
        return self.pages[kind]


@pytest.fixture(scope="module")
def fitted(
    tmp_path_factory: pytest.TempPathFactory, watched_figures: Callable[[], AbstractContextManager[Any]]
) -> Fitted:
    return Fitted(tmp_path_factory.mktemp("pages"), watched_figures)


@pytest.fixture(scope="module")
def fingers(simulate: Callable[..., Trial], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fingers")
    for number, (finger, depth) in enumerate((f, d) for f in ("index", "thumb") for d in (0.2, 0.4, 0.8)):
        write_trial(
            folder / f"{finger}_{depth}.h5",
            simulate(depth, seed=number, finger=finger, hold_s=2.0, dwell_s=0.3),
        )
    return folder


@pytest.fixture(scope="module")
def gels(convex: Callable[..., Trial], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("gels")
    for number, depth in enumerate((2.0, 2.05, 6.0)):
        trial = convex(
            1.5, rate_hz=20.0, depth_mm=depth, ramp_s=1.0, hold_s=25.0, seed=number, signal_to_noise=300.0
        )
        write_trial(folder / f"gel_{number}.h5", trial)
    lost = convex(1.5, rate_hz=20.0, shares=(0.0, 0.0), signal_to_noise=20.0)
    write_trial(folder / "hardly_relaxes.h5", replace(lost, log=("imported from a stranger's file",)))
    return folder


def recordings(kind: str, tmp_path: Path) -> Path:
    if not RECORDINGS.is_dir():
        pytest.skip("the real recordings are not beside the project")
    if kind == "afm_relaxation":
        pytest.importorskip("afmformats")
    import_recordings([RECORDINGS / kind], tmp_path / "trials")
    return tmp_path / "trials"


@pytest.mark.parametrize("kind", ["fingers", "gels", "aurora_ddf", "afm_relaxation"])
def test_nothing_is_cut_off_or_overprinted_and_no_figure_is_empty(
    kind: str,
    fitted: Fitted,
    page_faults: Callable[[Path], list[str]],
    request: pytest.FixtureRequest,
    tmp_path: Path,
):
    trials = request.getfixturevalue(kind) if kind in {"fingers", "gels"} else recordings(kind, tmp_path)
    page = fitted.page(kind, trials)
    assert fitted.faults[kind] == []
    assert page_faults(page) == []


def test_the_finger_study_stands_beside_fingers_alone(gels: Path, fingers: Path, fitted: Fitted):
    of_gels, of_fingers = fitted.page("gels", gels).read_text(), fitted.page("fingers", fingers).read_text()
    assert "Beside the published study" in of_fingers
    assert "finger" not in re.sub(r"data:image/png;base64,[^\"]*", "", of_gels)
    assert "p of d^p" in of_gels
    assert "% of peak" in of_gels
    assert "imported from a stranger" in of_gels
    numbers = re.findall(r"<td>([^<]*±[^<]*)</td>", of_gels)
    assert numbers
    for text in numbers:
        value, error = (float(re.sub(r"[()]|e-?\d+", "", part)) for part in text.split("±"))
        assert error < max(10 * abs(value), 1e-9), text


def test_what_is_not_told_is_left_empty(gels: Path, fitted: Fitted):
    document = json.loads((fitted.page("gels", gels).parent / "fits.json").read_text())
    (lost,) = [trial for trial in document["trials"] if trial["file"] == "hardly_relaxes.h5"]
    assert lost["failure"] or {"t1_s", "t2_s"} & lost["untold"].keys()
    assert not {"t1_s", "t2_s"} <= lost.keys()
    means = document["study"]["groups"][-1]["columns"]
    told = [trial["t1_s"]["value"] for trial in document["trials"] if "t1_s" in trial]
    assert means["t1_s"]["mean"] == pytest.approx(np.mean(told))
