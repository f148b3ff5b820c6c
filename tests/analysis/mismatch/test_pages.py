"""Pages of the diagnosis for four kinds of recording, looked at in a real browser."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.mismatch.diagnose import diagnose_paths
from analysis.recordings.importing import import_recordings

RECORDINGS = Path(__file__).parents[3].parent / "shared" / "recordings"
FOREIGN = ("finger", "bearing", "punch", "tissue", "skin")


def gel_csv(path: Path) -> Path:
    """Write what a material tester gives of a gel under a sphere: 20 Hz, a ramp of 1.5 s, a hold of 40 s."""
    rng = np.random.default_rng(3)
    time_s = np.arange(900) / 20.0
    depth_mm = np.clip((time_s - 1.5) / 1.5, 0.0, 1.0)
    relaxed = 1.0 + 0.6 * np.exp(-np.maximum(time_s - 3.0, 0.0) / 6.0)
    force_mn = 900.0 * depth_mm**1.5 * relaxed + rng.normal(size=len(time_s))
    rows = [f"{t:.3f},{x:.5f},{f:.4f}" for t, x, f in zip(time_s, depth_mm, force_mn, strict=True)]
    path.write_text("\n".join(["time_s,position_mm,force_mn", *rows]) + "\n")
    return path


def recorded(kind: str, folder: Path) -> Path:
    if kind == "tester":
        import_recordings([gel_csv(folder / "gel.csv")], folder / "trials")
        return folder / "trials"
    if not RECORDINGS.is_dir():
        pytest.skip("the real recordings are not beside the project")
    if kind == "afm":
        pytest.importorskip("afmformats")
        import_recordings([RECORDINGS / "afm_relaxation"], folder / "trials")
    else:
        import_recordings([RECORDINGS / "emps_servo" / "emps_train.csv"], folder / "trials", "air_sweep")
    return folder / "trials"


def words_of(page: Path) -> str:
    """Return the page's own words, without figures, styles and the log of the import."""
    text = re.sub(r"<(style|details)>.*?</\1>|<details.*?</details>", "", page.read_text(), flags=re.DOTALL)
    return re.sub(r"<[^>]*>", " ", text)


def test_the_page_of_a_finger_study(clinging: Any, page_faults: Callable[[Path], list[str]]) -> None:
    assert clinging.faults == []
    assert "the skin clings to the punch" in words_of(clinging.out / "report.html")
    assert page_faults(clinging.out / "report.html") == []


@pytest.mark.parametrize("kind", ["tester", "afm", "servo"])
def test_the_page_of_another_instrument(
    kind: str,
    tmp_path: Path,
    watched_figures: Callable[[], AbstractContextManager[list[str]]],
    page_faults: Callable[[Path], list[str]],
) -> None:
    trials = recorded(kind, tmp_path)
    with watched_figures() as faults:
        page = diagnose_paths([trials], out=tmp_path / "out")
    assert faults == []
    words = words_of(page)
    for foreign in FOREIGN:
        assert not re.search(rf"\b{foreign}", words), foreign
    assert "How the recordings were imported" in page.read_text()
    assert "Of the largest force" in words
    assert "noise floor was measured" in words
    assert not re.search(r"\de[+-]\d+ %", words)
    report = json.loads((page.parent / "report.json").read_text())
    assert all(window["share_of_mismatch"] > 0 for window in report["mismatch"])
    assert page_faults(page) == []
