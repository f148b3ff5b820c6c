"""Import: real recordings of other laboratories, and everything that must be refused, in which words."""

from __future__ import annotations

import random
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.recordings import read_trial
from analysis.recordings.importing import import_recordings
from analysis.recordings.trial import Trial

# seconds in which each lever stands at its 6 mm limit, read off the traces by eye
HOLDS = {
    "relaxation_100_1": (0.935, 1.184),
    "relaxation_10_1": (0.935, 1.187),
    "relaxation_20_1": (1.010, 1.163),
    "relaxation_30_2": (0.938, 1.198),
    "relaxation_70_1": (0.942, 1.179),
    "relaxation_90_2": (1.035, 1.161),
}


def _path_of(file: Path, out: Path, kind=None) -> Path:
    """Import one file; raises what the command would say where it is refused."""
    made, refused = import_recordings([file], out, kind)
    if refused:
        raise BadInputError(refused[0].reason)
    (one,) = made
    return one.path


def _imported(file: Path, out: Path, kind=None) -> Trial:
    path = _path_of(file, out, kind)
    trial = read_trial(path)
    assert path == out / f"{file.stem}.h5"
    assert (trial.source, trial.status, trial.software) == ("imported", "complete", "indenter")
    assert file.name in trial.log[0]
    return trial


def _refused(file: Path, out: Path, kind=None) -> str:
    with pytest.raises(BadInputError) as caught:
        _path_of(file, out, kind)
    assert "\n" not in str(caught.value)
    assert not out.exists() or not any(out.iterdir())
    return str(caught.value)


# Aurora .ddf


@pytest.mark.parametrize("name", HOLDS)
def test_the_window_in_which_the_lever_holds_position(name, shared, tmp_path):
    trial = _imported(shared / "aurora_ddf" / f"{name}.ddf", tmp_path)
    assert [p.name for p in trial.phases] == ["approach", "dwell", "ramp", "hold", "retract", "clear"]
    hold = trial.phase("hold")
    np.testing.assert_allclose((hold.start / 2000, hold.stop / 2000), HOLDS[name], atol=0.0025)
    position_mm, force_mn = trial.position_mm[hold.samples], trial.force_mn[hold.samples]
    assert np.abs(position_mm - np.median(position_mm)).max() <= 0.005
    assert abs(np.median(position_mm) - 6.0) < 0.05
    tenth = len(force_mn) // 10
    assert force_mn[:tenth].mean() > 1.03 * force_mn[-tenth:].mean()  # it relaxes
    assert trial.phase("approach").stop == trial.surface.sample
    ramp_mm = trial.position_mm[trial.phase("ramp").samples]
    assert trial.protocol.depth_mm == pytest.approx(np.median(position_mm) - ramp_mm[0], abs=1e-3)
    assert trial.surface.position_mm < ramp_mm[0] < 6.0


def test_changes_of_control_mode_and_ringing_are_events(shared, tmp_path):
    kinds = {
        name: [event.kind for event in _imported(shared / "aurora_ddf" / f"{name}.ddf", tmp_path).events]
        for name in HOLDS
    }
    assert kinds == {
        "relaxation_100_1": [],
        "relaxation_10_1": [],
        "relaxation_20_1": ["force_held", "control_mode"],
        "relaxation_30_2": ["ringing"],
        "relaxation_70_1": [],
        "relaxation_90_2": ["force_held", "control_mode"],
    }
    (ringing,) = read_trial(tmp_path / "relaxation_30_2.h5").events
    assert 170 < float(ringing.message.split("about ")[1].split(" Hz")[0]) < 230


@pytest.mark.parametrize(("name", "force_mn"), [("creep_20mN", 27), ("creep_400mN", 404)])
def test_a_lever_that_holds_force_has_no_hold(name, force_mn, shared, tmp_path):
    trial = _imported(shared / "aurora_ddf" / f"{name}.ddf", tmp_path)
    assert trial.phase("hold") is None
    assert [p.name for p in trial.phases] == ["approach", "dwell", "ramp", "retract", "clear"]
    (event,) = trial.events
    assert event.kind == "force_held"
    assert f"force held at {force_mn}" in event.message.replace("26.9", "27").replace("403.5", "404")
    assert any("no hold" in line for line in trial.log)


def test_a_ddf_keeps_its_volts_scales_commands_and_protocol(shared, tmp_path):
    trial = _imported(shared / "aurora_ddf" / "relaxation_100_1.ddf", tmp_path)
    assert trial.sample_rate_hz == 2000.0
    assert (trial.calibration.volts_per_mm, trial.calibration.volts_per_mn) == (1.0, 1 / 500)
    assert trial.force_mn.max() == pytest.approx(509.776)
    assert trial.command_mm.max() == 6.0
    assert trial.other_channels["force_command_mn"].max() == 900.0
    steps = tomllib.loads(trial.protocol.toml)["protocol_array"]
    assert [step["action"] for step in steps] == ["Ramp"] * 4 + ["Stop"]
    assert steps[1] == {"wait_s": 0.2, "action": "Ramp", "port": "Force Out", "parameters": "900, 0.05"}
    assert any("sign" in line for line in trial.log)


def test_a_twitch_has_no_phases(shared, tmp_path):
    trial = _imported(shared / "aurora_muscle_ddf" / "twitch.ddf", tmp_path)
    assert trial.phases == ()
    assert trial.n_samples == 4000
    assert any("last 1 sample(s), zero" in line for line in trial.log)
    assert any("nothing is pressed" in line for line in trial.log)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("aurora_ddf/all_zero_400.ddf", "position and force are zero throughout"),
        ("aurora_ddf/Emma400.0.dpf", "is a DMC protocol"),
        ("aurora_muscle_ddf/bad_units.ddf", "length (AI0) is in 'inch', not in mm; force (AI1) is in 'G'"),
        ("aurora_muscle_ddf/invalid_exp.ddf", "line 17: protocol action 'Stimulus-Strange' is unknown"),
        ("aurora_muscle_ddf/non-numeric.ddf", "line 26: AI5 is '\"a\"', not a number"),
        ("titin_ramps/AvgRelaxed_1s.csv", "lacks the column time_s, position_mm, force_mn (found Time, L, F"),
        ("aurora_ddf/LICENSE", "are not known: import takes .ddf, .csv"),
    ],
)
def test_real_files_that_are_refused(name, words, shared, tmp_path):
    assert words in _refused(shared / name, tmp_path / "out")


def test_every_real_recording_is_imported_or_refused(shared, tmp_path):
    imported, refused = [], []
    for number, file in enumerate(sorted(p for p in shared.glob("*/*") if p.is_file())):
        try:
            _path_of(file, tmp_path / str(number))
        except BadInputError as error:
            assert "\n" not in str(error)
            refused.append(file.name)
        else:
            imported.append(file.name)
    assert len(imported) == 11  # six relaxations, two creeps, the twitch, the AFM curve, the servo
    assert "emps_train.csv" in imported
    assert "fmt-jpk-sr_cell1-0008.jpk-force" in imported
    assert "all_zero_400.ddf" in refused


DDF = """DMCv5.3 Data File
Sample Frequency (Hz): 2000
Reference Length: NaN mm
Calibration Data:
Channel\tAI0\tAI1\tAO0\tAO1
Units\tmm\tmN\tmm\tmN
Scale (units/V)\t1.0\t500.0\t1.0\t500.0
Offset (volts)\t0.0\t0.0\t0.0\t0.0
Test Comments:

Protocol Array:

0.2\tRamp\tLength Out\t6, 0.5\t

Test Data in Volts:

Sample\tAI0\tAI1\tAO0\tAO1\tStim
"""


def _ddf(path: Path, header: str = DDF, rows: int = 3000) -> Path:
    t = np.arange(rows) / 2000
    x = np.interp(t, [0, 0.2, 0.4, 1.2, 1.4], [0, 0, 1, 1, 0])
    lines = (f"{i}\t{x[i]:.6f}\t{x[i] / 10:.6f}\t{x[i]:.6f}\t0.0\t0" for i in range(rows))
    path.write_text(header + "\n".join(lines) + "\n")
    return path


def test_a_ddf_of_a_lever_that_only_moves(tmp_path):
    trial = _imported(_ddf(tmp_path / "a.ddf"), tmp_path)
    assert [(p.name, p.start, p.stop) for p in trial.phases if p.name in {"ramp", "hold"}] == [
        ("ramp", pytest.approx(400, abs=8), pytest.approx(800, abs=8)),
        ("hold", pytest.approx(800, abs=8), pytest.approx(2400, abs=8)),
    ]


def test_header_lines_are_found_by_label_in_any_order(tmp_path):
    lines = DDF.splitlines()
    shuffled = [lines[0], *lines[4:8][::-1], lines[3], lines[2], "Something new: 7", lines[1], *lines[8:]]
    a = _imported(_ddf(tmp_path / "a.ddf"), tmp_path)
    b = _imported(_ddf(tmp_path / "b.ddf", "\n".join(shuffled) + "\n"), tmp_path)
    np.testing.assert_array_equal(a.force_mn, b.force_mn)
    assert a.phases == b.phases


def test_an_offset_is_named_with_the_sign_assumed(tmp_path):
    header = DDF.replace("Offset (volts)\t0.0\t0.0", "Offset (volts)\t0.5\t0.0")
    trial = _imported(_ddf(tmp_path / "a.ddf", header), tmp_path)
    assert trial.position_mm[0] == -0.5
    assert any("(volts - offset) x scale" in line and "AI0 0.5 V" in line for line in trial.log)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("DMCv5.3 Data File", "DMCv5.3 Protocol File", "line 1: is 'DMCv5.3 Protocol File'"),
        ("DMCv5.3 Data File", "Some other text", "this is no DMC recording"),
        ("Sample Frequency (Hz): 2000\n", "", "lacks the line 'Sample Frequency (Hz):'"),
        ("(Hz): 2000", "(Hz): fast", "Sample Frequency is 'fast'"),
        ("(Hz): 2000", "(Hz): -5", "Sample Frequency is '-5'"),
        ("(Hz): 2000", "(Hz): nan", "Sample Frequency is 'nan'"),
        ("Units\tmm\tmN", "Units\tmN\tmm", "length (AI0) is in 'mN', not in mm"),
        ("Units\tmm\tmN\tmm\tmN\n", "", "lacks the line 'Units'"),
        ("Scale (units/V)\t1.0", "Scale (units/V)\t0.0", "scale of AI0 is 0"),
        ("Scale (units/V)\t1.0", "Scale (units/V)\tx", "scale of AI0 is 0 or no number"),
        ("Scale (units/V)\t1.0\t500.0\t1.0\t500.0\n", "", "lacks the line 'Scale'"),
        ("Offset (volts)\t0.0", "Offset (volts)\tnan", "offset of AI0 is no number"),
        ("Sample\tAI0\tAI1", "Sample\tAI0\tAI2", "lacks the column AI1"),
        ("Sample\tAI0", "Samples\tAI0", "lacks the line 'Sample AI0 ...'"),
        ("10\t0.000000\t", "10\t0.0.0\t", "line 28: AI0 is '0.0.0', not a number"),
        ("10\t0.000000\t0.000000\t", "10\t0.000000\tinf\t", "line 28: AI1 is 'inf', not a number"),
        ("10\t0.000000\t0.000000\t", "10\t", "line 28: has 4 values for 6 columns"),
    ],
)
def test_a_spoiled_ddf_is_refused(old, new, words, tmp_path):
    file = _ddf(tmp_path / "a.ddf")
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    assert words in _refused(file, tmp_path / "out")


# text


def _csv(path: Path, time_s, position_mm, force_mn, header="time_s,position_mm,force_mn") -> Path:
    rows = zip(time_s, position_mm, force_mn, strict=True)
    path.write_text(header + "\n" + "".join(f"{t:.7g},{x:.7g},{f:.7g}\n" for t, x, f in rows))
    return path


def _press(t):
    x = np.interp(t, [0, 0.5, 2.5, 4.5, 4.6, 9.6, 10.0, 11.0], [2, 2, 4, 4, 4.4, 4.4, 2, 2])
    return x, 100 * np.maximum(x - 4, 0) + 1


def test_a_text_recording(tmp_path):
    t = np.arange(22_000) / 2000
    x, f = _press(t)
    trial = _imported(_csv(tmp_path / "a.csv", t, x, f), tmp_path / "out")
    assert trial.sample_rate_hz == 2000.0
    np.testing.assert_allclose(trial.position_mm, x, atol=1e-6)
    np.testing.assert_allclose(trial.force_mn, f, atol=1e-4)
    assert [p.name for p in trial.phases] == ["approach", "dwell", "ramp", "hold", "retract", "clear"]
    starts = [0, 2.5, 4.5, 4.6, 9.6, 10.0]
    np.testing.assert_allclose([p.start / 2000 for p in trial.phases], starts, atol=0.009)
    assert trial.native is None
    assert trial.command_v is None


def test_columns_in_any_order_blank_lines_extra_columns_and_a_byte_order_mark(tmp_path):
    rows = "".join(f"\n{i},{i * 0.1:.3f},,{0.2 * i},\n" for i in range(20))
    (tmp_path / "a.csv").write_text(f"\ufeff force_mn , time_s,note,command_mm,position_mm\n\n  \n{rows}")
    text = (tmp_path / "a.csv").read_text().replace(",\n", ",5\n")
    (tmp_path / "a.csv").write_text(text)
    trial = _imported(tmp_path / "a.csv", tmp_path / "out", "air_sweep")
    assert trial.sample_rate_hz == 10.0
    np.testing.assert_allclose(trial.command_mm, 0.2 * np.arange(20))
    assert any("columns ignored: note" in line for line in trial.log)
    assert any("blank lines skipped: 22" in line for line in trial.log)
    assert [(p.name, p.start, p.stop) for p in trial.phases] == [("sweep", 0, 20)]


def test_uneven_time_is_resampled_and_kept(tmp_path):
    t = 2 + np.concatenate([np.linspace(0, 1, 50), np.geomspace(1.05, 60, 70)])
    x = np.interp(t, [2, 3], [0, 1])
    f = 100 * x * np.exp(-np.maximum(t - 3, 0) / 20)
    trial = _imported(_csv(tmp_path / "a.csv", t, x, f), tmp_path / "out")
    assert trial.sample_rate_hz == pytest.approx(49, rel=1e-3)
    assert trial.n_samples == pytest.approx(60 * 49, abs=3)
    np.testing.assert_allclose(trial.native.time_s, t - 2, atol=1e-5)
    np.testing.assert_allclose(trial.native.force_mn, f, rtol=1e-5)
    np.testing.assert_allclose(
        np.interp(trial.time_s, trial.native.time_s, trial.native.force_mn), trial.force_mn
    )
    assert [p.name for p in trial.phases] == ["ramp", "hold"]
    assert any("unevenly sampled: 120 samples" in line for line in trial.log)
    assert any("it was 2 s in the file" in line for line in trial.log)


def test_a_hold_with_a_little_creep_is_a_hold(tmp_path):
    t = np.arange(8000) / 1000
    x = np.interp(t, [0, 1, 1.2, 7, 7.5], [0, 0, 1, 1.03, 0]) + np.random.default_rng(0).normal(0, 5e-4, 8000)
    trial = _imported(_csv(tmp_path / "a.csv", t, x, 10 + x), tmp_path / "out")
    assert [p.name for p in trial.phases] == ["approach", "ramp", "hold", "retract", "clear"]
    assert trial.phase("hold").start == pytest.approx(1200, abs=12)
    assert trial.phase("hold").stop == pytest.approx(7000, abs=12)


def test_a_sweep_without_a_hold_has_no_phases_unless_it_is_said_to_be_one(tmp_path):
    t = np.arange(4000) / 1000
    x = 2 + np.sin(2 * np.pi * t)
    file = _csv(tmp_path / "a.csv", t, x, np.cos(t))
    trial = _imported(file, tmp_path / "a")
    assert "hold" not in [p.name for p in trial.phases]
    assert _imported(file, tmp_path / "b", "air_sweep").phases[0].name == "sweep"
    assert _imported(file, tmp_path / "c", "force_calibration").phases == ()


def test_the_real_servo_is_one_sweep(shared, tmp_path):
    trial = _imported(shared / "emps_servo" / "emps_train.csv", tmp_path, "air_sweep")
    assert trial.kind == "air_sweep"
    assert trial.sample_rate_hz == 1000.0
    assert [(p.name, p.start, p.stop) for p in trial.phases] == [("sweep", 0, 24841)]
    assert trial.command_mm is not None
    assert trial.force_mn[0] == pytest.approx(89234.43)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty (0 bytes)"),
        ("\n\n", "lacks the column"),
        ("time_s,position_mm,force_N\n", "lacks the column force_mn (found time_s, position_mm, force_N)"),
        ("time_s;position_mm;force_mn\n0;0;0\n", "separate columns by commas"),
        ("time_s,time_s,position_mm,force_mn\n", "has the column time_s twice"),
        ("time_s,position_mm,force_mn\n", "has 0 rows of samples"),
        ("time_s,position_mm,force_mn\n0,1,2\n", "has 1 rows of samples"),
        ("time_s,position_mm,force_mn\n0,1,2\n\n1,x,2\n", "line 4: position_mm is 'x', not a number"),
        ("time_s,position_mm,force_mn\n0,1,nan\n", "line 2: force_mn is nan"),
        ("time_s,position_mm,force_mn\n0,1,-inf\n", "line 2: force_mn is -inf"),
        ("time_s,position_mm,force_mn\n0,1\n", "line 2: has 2 values for 3 columns"),
        ("time_s,position_mm,force_mn\n0,1,2,3\n", "line 2: has 4 values for 3 columns"),
        ("time_s,position_mm,force_mn\n0,,2\n", "line 2: position_mm is ''"),
        ("time_s,position_mm,force_mn\n" + "0,1,2\n" * 20, "line 3: time_s is 0 after 0"),
        (
            "time_s,position_mm,force_mn\n" + "".join(f"{9 - i},1,2\n" for i in range(9)),
            "line 3: time_s is 8",
        ),
        ("time_s,position_mm,force_mn\n" + "".join(f"{i},0,0\n" for i in range(9)), "zero throughout"),
        ("time_s,position_mm,force_mn\n" + "".join(f"{i},{i},0\n" for i in range(9)), "force is zero"),
        (
            "time_s,position_mm,force_mn\n" + "".join(f"{i},1e300,1\n" for i in range(9)),
            "is 1e+300 at sample 0",
        ),
    ],
)
def test_a_spoiled_text_is_refused(text, words, tmp_path):
    (tmp_path / "a.csv").write_text(text)
    assert words in _refused(tmp_path / "a.csv", tmp_path / "out")


def test_a_binary_csv_is_refused(tmp_path):
    for contents in (b"\xff\xfe\x00t\x00i", b"time_s,position_mm,force_mn\n\xff,1,2\n", b"a\0b\n"):
        (tmp_path / "a.csv").write_bytes(contents)
        _refused(tmp_path / "a.csv", tmp_path / "out")


# AFM


def test_an_afm_relaxation(shared, tmp_path):
    pytest.importorskip("afmformats", reason="the AFM importer's package is not installed")
    trial = _imported(shared / "afm_relaxation" / "fmt-jpk-sr_cell1-0008.jpk-force", tmp_path)
    assert [p.name for p in trial.phases] == ["approach", "ramp", "hold", "retract"]
    starts = [p.start / trial.sample_rate_hz for p in trial.phases]
    np.testing.assert_allclose(starts, [0, 1, 2, 32], atol=1e-3)
    assert trial.sample_rate_hz == 2048.0
    assert len(trial.native.time_s) == 11935
    force_nn, position_um = 1e6 * trial.force_mn, 1e3 * trial.position_mm
    hold = trial.phase("hold").samples
    assert force_nn[hold][0] > 200  # about 207 nN, relaxing towards 0 within 30 s
    assert abs(force_nn[hold][-1]) < 5
    # the cantilever travels 20 um and stands; its tip follows by what the bending of 1.09 N/m gives back
    (line,) = (line for line in trial.log if "less the bending" in line)
    spring = float(line.split("over ")[1].split(" N/m")[0])
    travel_um = position_um + (force_nn - np.median(force_nn[:50])) / spring / 1e3
    assert np.median(travel_um[hold]) == pytest.approx(20.0, abs=0.05)
    assert np.ptp(travel_um[hold]) < 0.05
    assert np.ptp(position_um[hold]) > 0.1
    assert trial.protocol.ramp_speed_mm_s == pytest.approx(0.02)
    assert trial.started.startswith("2018-11-22T11:55:14")


def test_an_afm_file_without_its_package_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "afmformats", None)
    (tmp_path / "a.jpk-force").write_bytes(b"x")
    assert "pip install indenter[afm]" in _refused(tmp_path / "a.jpk-force", tmp_path / "out")


@pytest.mark.parametrize("name", ["a.jpk-force", "a.ibw", "a.tab", "a.h5", "a.txt", "a.zip"])
def test_broken_afm_files_are_refused(name, tmp_path, capfd):
    pytest.importorskip("afmformats", reason="the AFM importer's package is not installed")
    (tmp_path / name).write_bytes(b"PK\x03\x04 this is no recording \x00\x01")
    assert name in _refused(tmp_path / name, tmp_path / "out")
    assert capfd.readouterr() == ("", "")


def test_a_trial_file_needs_no_import(tmp_path, foreign_file):
    assert "is a trial file already" in _refused(foreign_file(), tmp_path / "out")


# damage


@pytest.mark.parametrize("ending", ["ddf", "csv"])
def test_damaged_texts_are_imported_or_refused(ending, tmp_path):
    """Characters lost, changed and doubled at random: a trial that can be read, or one line."""
    t = np.arange(400) / 100
    x, f = _press(3 * t)
    good = tmp_path / f"good.{ending}"
    contents = (_ddf(good, rows=400) if ending == "ddf" else _csv(good, t, x, f)).read_bytes()
    rng = random.Random(ending)
    refused = 0
    for number in range(150):
        damaged = bytearray(contents)
        for _ in range(rng.choice([1, 1, 3, 20])):
            # half of the damage strikes the header, where most of it matters
            where = rng.randrange(len(damaged) if rng.random() < 0.5 else 500)
            match rng.randrange(4):
                case 0:
                    del damaged[where : where + rng.randrange(1, 30)]
                case 1:
                    damaged[where] = rng.randrange(256)
                case 2:
                    damaged[where:where] = damaged[max(0, where - 20) : where]
                case 3:
                    damaged[where : where + 1] = rng.choice(
                        [b"\t", b",", b"\n", b"1e400", b"-", b"\0", b"9" * 30]
                    )
        file = tmp_path / f"{number}.{ending}"
        file.write_bytes(damaged)
        try:
            path = _path_of(file, tmp_path / "out")
        except BadInputError as error:
            assert "\n" not in str(error)
            refused += 1
        else:
            trial = read_trial(path)
            assert np.isfinite(trial.position_mm).all()
    assert 20 < refused < 150


# batches


def test_a_bad_file_in_a_batch_stops_no_other(tmp_path):
    good, bad, out = _ddf(tmp_path / "good.ddf"), tmp_path / "bad.ddf", tmp_path / "out"
    bad.write_text("nonsense")
    made, refused = import_recordings([bad, good, tmp_path / "none.ddf"], out)
    assert [one.path for one in made] == [out / "good.h5"]
    assert [one.source for one in refused] == [bad, tmp_path / "none.ddf"]
    assert "bad.ddf" in refused[0].reason
    assert "no such file" in refused[1].reason
    assert [p.name for p in out.iterdir()] == ["good.h5"]


def test_two_files_of_one_name_are_one_trial_and_a_refusal(tmp_path):
    (tmp_path / "b").mkdir()
    files = [_ddf(tmp_path / "a.ddf"), _ddf(tmp_path / "b" / "a.ddf")]
    made, refused = import_recordings(files, tmp_path / "out")
    assert len(made) == 1
    assert "two files" in refused[0].reason


def test_nothing_to_import_is_said(tmp_path):
    for paths in ([], [tmp_path]):
        with pytest.raises(BadInputError, match="nothing to import"):
            import_recordings(paths, tmp_path / "out")


def test_a_batch_is_written_and_nothing_is_overwritten(tmp_path):
    files = [_ddf(tmp_path / f"{name}.ddf") for name in "ab"]
    out = tmp_path / "new" / "folder"
    made, _ = import_recordings(files, out)
    assert [one.path for one in made] == [out / "a.h5", out / "b.h5"]
    assert sorted(p.name for p in out.iterdir()) == ["a.h5", "b.h5"]
    before = (out / "a.h5").read_bytes()
    made, refused = import_recordings(files, out)
    assert not made
    assert all("exists already" in one.reason for one in refused)
    assert (out / "a.h5").read_bytes() == before


def test_a_place_that_cannot_be_written(tmp_path):
    (tmp_path / "out").write_text("a file, not a folder")
    with pytest.raises(BadInputError, match="can't be written"):
        import_recordings([_ddf(tmp_path / "a.ddf")], tmp_path / "out")
