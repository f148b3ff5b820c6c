"""The Python interface as its documentation shows it, and the example scripts."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

import analysis
from analysis.recordings import write_trial
from analysis.recordings.trial import Trial


@pytest.fixture(scope="module")
def study(bench_trials: Callable[..., list[Trial]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    from sim_hardware.concealment.offline import study_plans

    folder = tmp_path_factory.mktemp("study")
    plans: Sequence[Any] = study_plans(depths_mm=(0.3, 0.7), repeats=2, hold_s=2.0, dwell_s=0.4)
    trials = bench_trials("seed = 3\n[specimens]\npublished_tissue = true\n", plans)
    for number, trial in enumerate(trials):
        write_trial(folder / f"trial_{number:02d}.h5", trial)
    return folder


def test_every_name_is_there_and_nothing_heavy_is_loaded_before():
    for name in analysis.__all__:
        assert getattr(analysis, name) is not None
    with pytest.raises(AttributeError):
        _ = analysis.nothing  # type: ignore[attr-defined]
    code = "import sys, analysis; sys.exit(any(m in sys.modules for m in ('numpy', 'scipy', 'h5py')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_read_and_fit(study: Path):
    from analysis import find_trials, fit_trial, read_trial

    fit = fit_trial(read_trial(find_trials([study])[0]))
    assert fit.fitted
    assert fit.estimates["t1_s"].value == pytest.approx(2.279, rel=0.2)


def test_the_fitting_example_runs(study: Path, capsys: pytest.CaptureFixture[str]):
    from analysis.examples.fit_a_folder import main

    (study / "broken.h5").write_bytes(b"nothing")
    main(study)
    (study / "broken.h5").unlink()
    said = capsys.readouterr().out
    assert said.count("t1_s = ") == len(list(study.glob("*.h5")))
    assert "0.3 mm: t1 is" in said
    assert "broken.h5" in said


def test_the_diagnosing_example_runs(study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    from analysis.examples.what_is_left_out import main

    main(study, tmp_path / "diagnosis")
    said = capsys.readouterr().out
    report = json.loads((tmp_path / "diagnosis" / "report.json").read_text())
    assert said.startswith(f"{report['verdict']}: ")
    assert "mN rms" in said
