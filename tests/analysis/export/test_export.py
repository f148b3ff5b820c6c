"""Trials for other programs: what is written is read back by those programs, and is what was recorded."""

from __future__ import annotations

import importlib.util
import sys
import warnings
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.export.exporting import export_trials
from analysis.recordings import read_trial, write_trial
from analysis.recordings.importing import import_recordings
from analysis.recordings.trial import Event
from rig.cli import main


@pytest.fixture(scope="module")
def simulator() -> ModuleType:
    path = Path(__file__).parents[1] / "relaxation" / "conftest.py"
    spec = importlib.util.spec_from_file_location("export_simulator", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def folder(simulator: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from dataclasses import replace

    made = tmp_path_factory.mktemp("study")
    trial = simulator.simulate_trial(0.4, hold_s=2.0, dwell_s=0.3)
    write_trial(made / "finger.h5", replace(trial, events=(Event(5, "limit", "near the end"),)))
    write_trial(made / "uneven.h5", simulator.simulate_convex(1.5, uneven=True))
    (made / "broken.h5").write_bytes(b"nothing")
    return made


def test_csv_comes_back_by_import(folder: Path, tmp_path: Path):
    done = export_trials([folder], "csv", tmp_path / "csv")
    assert [path.name for path, _ in done.left_out] == ["broken.h5"]
    assert (tmp_path / "csv" / "fits" / "fits.csv").read_text().count("\n") == 3
    for name in ("finger", "uneven"):
        before = read_trial(folder / f"{name}.h5")
        (made,), refused = import_recordings([tmp_path / "csv" / f"{name}.csv"], tmp_path / "back")
        assert not refused
        after = read_trial(made.path)
        if before.native is not None:
            assert after.native is not None
            np.testing.assert_allclose(after.native.force_mn, before.native.force_mn, rtol=1e-6, atol=1e-6)
            continue
        np.testing.assert_allclose(after.force_mn, before.force_mn, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(after.position_mm, before.position_mm, rtol=1e-6)
        assert after.command_mm is not None
        assert after.sample_rate_hz == before.sample_rate_hz


def test_parquet_is_tidy(folder: Path, tmp_path: Path):
    io = pytest.importorskip("arro3.io", reason="the Parquet package is not installed")
    export_trials([folder], "parquet", tmp_path)
    trials = io.read_parquet(tmp_path / "trials.parquet").read_all()
    samples = io.read_parquet(tmp_path / "samples.parquet").read_all()
    assert trials["trial"].to_pylist() == ["finger", "uneven"]
    assert trials["t1_s"].to_numpy()[0] == pytest.approx(2.279, rel=0.1)
    assert trials["exponent"].to_numpy()[1] == pytest.approx(1.5, abs=0.3)
    finger = read_trial(folder / "finger.h5")
    names = np.array(samples["trial"].to_pylist())
    force_mn = samples["force_mn"].to_numpy()[names == "finger"]
    np.testing.assert_allclose(force_mn, finger.force_mn)
    phases = np.array(samples["phase"].to_pylist())[names == "finger"]
    hold = finger.phase("hold")
    assert hold is not None
    assert np.all(phases[hold.samples] == "hold")
    assert phases[hold.start - 1] == "ramp"


def test_nwb_is_valid_and_in_si_units(folder: Path, tmp_path: Path):
    pytest.importorskip("pynwb", reason="the NWB package is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its own dependencies
        from pynwb import NWBHDF5IO, validate

        done = export_trials([folder], "nwb", tmp_path)
        assert len(done.written) == 2
        for path in done.written:
            assert validate(path=str(path)) == []
        with NWBHDF5IO(tmp_path / "finger.nwb", "r") as file:
            made = file.read()
            trial = read_trial(folder / "finger.h5")
            force = made.acquisition["indentation_force"]
            np.testing.assert_allclose(force.data[:] * force.conversion * 1e3, trial.force_mn, rtol=1e-9)
            assert (force.unit, force.rate) == ("newtons", 8000.0)
            assert made.acquisition["indentation_position"].unit == "meters"
            epochs = made.epochs.to_dataframe()
            assert [tags[0] for tags in epochs["tags"]] == [phase.name for phase in trial.phases]
            assert made.acquisition["events"].data[0] == "limit: near the end"
            assert made.subject.species == "Homo sapiens"
            table = made.processing["misc"]["relaxation_fit"].to_dataframe().set_index("quantity")
            assert table.loc["t1_s", "value"] == pytest.approx(2.279, rel=0.1)
        with NWBHDF5IO(tmp_path / "uneven.nwb", "r") as file:
            made = file.read()
            native = read_trial(folder / "uneven.h5").native
            assert native is not None
            np.testing.assert_allclose(made.acquisition["indentation_force"].timestamps[:], native.time_s)


@pytest.mark.parametrize("to", ["csv", "nwb", "parquet"])
def test_nothing_is_overwritten_and_nothing_to_export_is_said(to: str, folder: Path, tmp_path: Path):
    pytest.importorskip({"csv": "numpy", "nwb": "pynwb", "parquet": "arro3.io"}[to])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        export_trials([folder / "finger.h5"], to, tmp_path / "out")
        with pytest.raises(BadInputError, match="exists already"):
            export_trials([folder / "finger.h5"], to, tmp_path / "out")
    with pytest.raises(BadInputError, match="broken"):
        export_trials([folder / "broken.h5"], to, tmp_path / "none")


@pytest.mark.parametrize(("to", "package"), [("nwb", "pynwb"), ("parquet", "arro3.io")])
def test_a_missing_package_says_what_to_install(to, package, folder, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(BadInputError, match=rf"pip install indenter\[{to}\]"):
        export_trials([folder / "finger.h5"], to, tmp_path)


def test_the_command(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["export", str(folder), "--to", "csv", "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr()
    assert str(tmp_path / "out" / "finger.csv") in said.out
    assert "left out" in said.err
    assert "broken.h5" in said.err
