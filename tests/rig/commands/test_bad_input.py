"""Every broken file gives exit code 2 and one clear line on stderr, and leaves nothing behind."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from analysis.recordings import write_trial
from analysis.recordings.trial import Calibration, Phase, Surface, Trial
from rig.cli import main

RECORDINGS = Path(__file__).resolve().parents[4] / "shared" / "recordings"

GOOD_PROTOCOL = """
kind = "ramp_hold_retract"
[indentation]
depth_mm = 0.4
"""

INDENT = 'kind = "ramp_hold_retract"\n[indentation]\n'
PROTOCOLS = {
    "empty": "",
    "not_toml": "kind = \n",
    "no_kind": "[indentation]\ndepth_mm = 0.4\n",
    "unknown_kind": 'kind = "poke"\n',
    "kind_is_a_number": "kind = 3\n",
    "missing_depth": INDENT,
    "negative_depth": INDENT + "depth_mm = -0.4\n",
    "zero_depth": INDENT + "depth_mm = 0.0\n",
    "nan_depth": INDENT + "depth_mm = nan\n",
    "infinite_depth": INDENT + "depth_mm = inf\n",
    "depth_in_um": INDENT + "depth_um = 400.0\n",
    "depth_as_text": INDENT + 'depth_mm = "0.4 mm"\n',
    "depth_beyond_the_lever": INDENT + "depth_mm = 12.0\n",
    "depth_beyond_the_travel": INDENT + "depth_mm = 9.8\n",
    "negative_hold": INDENT + "depth_mm = 0.4\nhold_s = -1.0\n",
    "hold_in_minutes": INDENT + "depth_mm = 0.4\nhold_min = 1.0\n",
    "speed_beyond_the_limit": INDENT + "depth_mm = 0.4\nramp_speed_mm_s = 500.0\n",
    "zero_speed": INDENT + "depth_mm = 0.4\nramp_speed_mm_s = 0.0\n",
    "indentation_is_no_table": 'kind = "ramp_hold_retract"\nindentation = 0.4\n',
    "unknown_finger": INDENT + 'depth_mm = 0.4\n[specimen]\nfinger = "pinkie"\n',
    "more_samples_than_watched": INDENT + "depth_mm = 0.4\n[surface]\nsamples_above = 11\n",
    "threshold_beyond_the_force_limit": INDENT + "depth_mm = 0.4\n[surface]\ncontact_threshold_mn = 450.0\n",
    "start_beyond_the_travel": INDENT + "depth_mm = 0.4\n[surface]\nstart_mm = 9.9\n",
    "no_fingers": 'kind = "study"\n[study]\nfingers = []\n',
    "a_depth_twice": 'kind = "study"\n[study]\ndepths_mm = [0.2, 0.2]\n',
    "rests_backwards": 'kind = "study"\n[study]\nrest_s = [180.0, 120.0]\n',
    "half_a_repeat": 'kind = "study"\n[study]\nrepeats = 1.5\n',
    "order_unknown": 'kind = "study"\n[study]\norder = "random"\n',
    "sweep_backwards": 'kind = "air_sweep"\nstart_mm = 8.0\nstop_mm = 2.0\n',
    "sweep_too_fast": 'kind = "air_sweep"\nsweep_speeds_mm_s = [200.0]\n',
    "two_heights": 'kind = "position_calibration"\nstep_um = 700.0\n',
    "two_masses": 'kind = "force_calibration"\nmasses_g = [1.0, 1.0, 2.0]\n',
    "too_heavy": 'kind = "force_calibration"\nmasses_g = [0.0, 10.0, 100.0]\n',
}

RIGS = {
    "not_toml": "[card\n",
    "unknown_table": "[daq]\n",
    "unknown_key": '[card]\nadress = "x"\n',
    "companion_missing": '[card]\naddress = "companion:card"\n',
    "same_input_twice": '[card]\nposition_channel = "ai1"\n',
    "output_as_input": '[card]\nforce_channel = "ao1"\n',
    "rate_as_text": '[card]\nsample_rate_hz = "8 kHz"\n',
    "negative_rate": "[card]\nsample_rate_hz = -8000.0\n",
    "nan_limit": "[lever]\nforce_max_mn = nan\n",
    "force_beyond_the_lever": "[lever]\nforce_max_mn = 900.0\n",
    "travel_beyond_the_lever": "[lever]\ntravel_max_mm = 12.0\n",
    "travel_beyond_the_card": "[lever]\ntravel_max_mm = 9.9\n",
    "travel_backwards": "[lever]\ntravel_min_mm = 5.0\ntravel_max_mm = 4.0\n",
    "safe_outside": "[lever]\nsafe_position_mm = 9.8\n",
    "retreat_too_fast": "[lever]\nretreat_speed_mm_s = 200.0\n",
    "zero_slope": "[calibration]\nvolts_per_mn = 0.0\n",
    "companion_without_command": "[companion]\n",
    "guard_too_nervous": "[guard]\nheartbeat_timeout_s = 0.01\n",
    "punch_of_nothing": "[punch]\ndiameter_mm = 0.0\n",
}

TEXTS = {
    "empty.csv": "",
    "header_only.csv": "time_s,position_mm,force_mn\n",
    "no_force.csv": "time_s,position_mm\n0,0\n1,1\n",
    "wrong_unit.csv": "time_ms,position_um,force_n\n0,0,0\n1,1,1\n",
    "text_in_a_row.csv": "time_s,position_mm,force_mn\n0,0,0\n0.1,zero,1\n",
    "nan_in_a_row.csv": "time_s,position_mm,force_mn\n0,0,0\n0.1,nan,1\n",
    "time_stands_still.csv": "time_s,position_mm,force_mn\n0,0,0\n0,0,1\n0,1,1\n",
    "time_runs_back.csv": "time_s,position_mm,force_mn\n0,0,0\n0.2,0,1\n0.1,1,1\n",
    "short_row.csv": "time_s,position_mm,force_mn\n0,0,0\n0.1,1\n",
    "one_sample.csv": "time_s,position_mm,force_mn\n0,0,0\n",
    "binary.csv": "\x00\x01\x02\x03",
    "empty.ddf": "",
    "no_ddf.ddf": "this is no Aurora file\n1\t2\t3\n",
    "cut_in_the_header.ddf": "DMCv5.3 Data File\nSample Frequency (Hz): 2000\n",
    "unknown.xyz": "what is this\n",
}

MALFORMED = ["bad_units.ddf", "invalid_exp.ddf", "non-numeric.ddf"]


def good_trial() -> Trial:
    n = 800
    return Trial(
        trial_id="0",
        started="2026-01-01T00:00:00+00:00",
        kind="ramp_hold_retract",
        source="simulated",
        status="complete",
        sample_rate_hz=8000.0,
        position_v=np.linspace(-1, 1, n),
        force_v=np.linspace(0, 1, n),
        command_v=np.linspace(-1, 1, n),
        calibration=Calibration(2.0, -10.0, 0.015, 0.0, 2.0, -10.0),
        phases=(Phase("approach", 0, 200), Phase("ramp", 200, 400), Phase("hold", 400, 800)),
        surface=Surface(4.0, 190, 3.0, 10.0),
    )


def _attribute(group: str, name: str, value: object) -> Callable[[Path], None]:
    def spoil(path: Path) -> None:
        with h5py.File(path, "r+") as file:
            if value is None:
                del file[group].attrs[name]
            else:
                file[group].attrs[name] = value

    return spoil


def _dataset(name: str, values: object) -> Callable[[Path], None]:
    def spoil(path: Path) -> None:
        with h5py.File(path, "r+") as file:
            del file[name]
            if values is not None:
                file[name] = values

    return spoil


def _cut(share: float) -> Callable[[Path], None]:
    return lambda path: path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])


def _overwrite(content: bytes) -> Callable[[Path], None]:
    def spoil(path: Path) -> None:
        path.write_bytes(content)

    return spoil


TRIALS = {
    "empty": _overwrite(b""),
    "text": _overwrite(b"position, force\n1, 2\n"),
    "truncated": _cut(0.5),
    "header_only": _cut(0.05),
    "other_format": _attribute("/", "format", "other"),
    "newer_version": _attribute("/", "format_version", 2),
    "no_status": _attribute("/", "status", None),
    "unknown_kind": _attribute("/", "kind", "poke"),
    "no_rate": _attribute("signals", "sample_rate_hz", None),
    "zero_rate": _attribute("signals", "sample_rate_hz", 0.0),
    "nan_slope": _attribute("calibration", "volts_per_mm", np.nan),
    "no_slope": _attribute("calibration", "volts_per_mn", None),
    "no_force": _dataset("signals/force_v", None),
    "unequal_lengths": _dataset("signals/force_v", np.zeros(10)),
    "no_samples": _dataset("signals/position_v", np.zeros(0)),
    "two_dimensions": _dataset("signals/position_v", np.zeros((2, 400))),
    "text_for_samples": _dataset("signals/position_v", b"abc"),
    "no_phases": _dataset("phases", None),
    "phases_without_fields": _dataset("phases", np.zeros(3)),
}


def refused(argv: list[str], capsys: pytest.CaptureFixture[str], place: Path, named: str) -> str:
    """Run a command in-process; assert exit code 2, one line that names the file, and nothing written."""
    before = sorted(place.rglob("*"))
    code = main(argv)
    said = capsys.readouterr()
    assert code == 2, said.err
    lines = said.err.splitlines()
    assert len(lines) == 1, said.err
    assert "Traceback" not in said.err
    assert named in lines[0]
    assert len(lines[0]) > len(named) + 20, "it says what is wrong"
    assert sorted(place.rglob("*")) == before, "nothing is written"
    return lines[0]


@pytest.mark.parametrize("case", PROTOCOLS)
def test_protocol_files(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bad_protocol.toml"
    path.write_text(PROTOCOLS[case])
    refused(["run", str(path), "--out", str(tmp_path / "out")], capsys, tmp_path, path.name)


@pytest.mark.parametrize("case", RIGS)
def test_rig_files(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    protocol, path = tmp_path / "protocol.toml", tmp_path / "bad_rig.toml"
    protocol.write_text(GOOD_PROTOCOL)
    path.write_text(RIGS[case])
    out = str(tmp_path / "out")
    refused(["run", str(protocol), "--rig", str(path), "--out", out], capsys, tmp_path, path.name)
    refused(["calibrate", "force", "--rig", str(path), "--out", out], capsys, tmp_path, path.name)


@pytest.mark.parametrize("case", TRIALS)
def test_trial_files(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bad_trial.h5"
    write_trial(path, good_trial())
    TRIALS[case](path)
    content = path.read_bytes()
    refused(["discard", str(path), "--reason", "no good"], capsys, tmp_path, path.name)
    assert path.read_bytes() == content


def test_all_zero_force_is_refused_by_the_diagnosis(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "zero.h5"
    trial = good_trial()
    write_trial(path, replace(trial, force_v=np.zeros_like(trial.force_v)))
    refused(["diagnose", str(path), "--out", str(tmp_path / "out")], capsys, tmp_path, "zero")


@pytest.mark.parametrize("name", TEXTS)
def test_text_files(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / name
    path.write_text(TEXTS[name])
    refused(["import", str(path), "--out", str(tmp_path / "out")], capsys, tmp_path, name)


@pytest.mark.skipif(not RECORDINGS.is_dir(), reason="the shared recordings are not here")
@pytest.mark.parametrize("name", MALFORMED)
def test_malformed_recordings(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / name
    shutil.copyfile(RECORDINGS / "aurora_muscle_ddf" / name, path)
    refused(["import", str(path), "--out", str(tmp_path / "out")], capsys, tmp_path, name)


@pytest.mark.parametrize(
    "argv",
    [
        ["run", "no_such.toml"],
        ["run", "good.toml", "--rig", "no_such.toml"],
        ["fit", "no_such.h5"],
        ["diagnose", "no_such.h5"],
        ["import", "no_such.ddf", "--out", "out"],
        ["rescue", "no_such.h5"],
        ["discard", "no_such.h5", "--reason", "no good"],
    ],
    ids=lambda argv: argv[0],
)
def test_files_that_are_not_there(
    argv: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "good.toml").write_text(GOOD_PROTOCOL)
    refused(argv, capsys, tmp_path, "no_such")


@pytest.mark.parametrize(
    "argv",
    [
        [],
        ["dance"],
        ["calibrate"],
        ["calibrate", "time"],
        ["fit"],
        ["fit", "x.h5", "--model", "best"],
        ["fit", "x.h5", "--jobs", "0"],
        ["diagnose", "x.h5", "--tolerance", "-1"],
        ["diagnose", "x.h5", "--seed", "one"],
        ["prove", "--cases", "0"],
        ["import", "x.ddf"],
        ["import", "x.ddf", "--out", "o", "--kind", "poke"],
        ["discard", "x.h5"],
        ["run"],
    ],
    ids=" ".join,
)
def test_wrong_use(argv: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    refused(argv, capsys, tmp_path, "indenter")


def test_rescue_of_files_none_of_which_can_be_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("text.h5", "empty.h5"):
        (tmp_path / name).write_bytes(b"no trial" if name == "text.h5" else b"")
    assert main(["rescue", str(tmp_path)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert sorted(line.split(": ")[0] for line in said.err.splitlines()) == [
        str(tmp_path / "empty.h5"),
        str(tmp_path / "text.h5"),
    ]
    # one that can be read is a success
    write_trial(tmp_path / "whole.h5", good_trial())
    assert main(["rescue", str(tmp_path)]) == 0
    assert "whole.h5: is whole" in capsys.readouterr().out


def test_a_folder_of_another_run_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    protocol = tmp_path / "protocol.toml"
    protocol.write_text(GOOD_PROTOCOL)
    out = tmp_path / "out"
    out.mkdir()
    (out / "protocol.toml").write_text('kind = "study"\n')
    refused(["run", str(protocol), "--out", str(out)], capsys, tmp_path, "out")
    write_trial(tmp_path / "trial.h5", good_trial())
    (out / "protocol.toml").unlink()
    (tmp_path / "trial.h5").rename(out / "trial.h5")
    refused(["run", str(protocol), "--out", str(out)], capsys, tmp_path, "out")


@pytest.mark.parametrize("case", ["negative_depth", "not_toml"])
def test_as_a_real_process(case: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(PROTOCOLS[case])
    done = subprocess.run(
        [sys.executable, "-m", "rig.cli", "run", path.name],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == [path]
