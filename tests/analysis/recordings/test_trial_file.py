"""The trial file: what is written is read back, and stands in the file where the contract says."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields
from itertools import pairwise
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.errors import BadInputError
from analysis.recordings import find_trials, mark_discarded, read_trial, write_trial
from analysis.recordings.layout import ATTRIBUTES, attributes_of
from analysis.recordings.trial import (
    Calibration,
    Event,
    NativeSamples,
    Phase,
    ProtocolSummary,
    Specimen,
    Surface,
    Trial,
)

_number = st.floats(-1e9, 1e9)
_positive = st.floats(1e-9, 1e9)
_slope = st.one_of(_positive, _positive.map(lambda value: -value))
_text = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=30)


def _maybe(strategy):
    return st.one_of(st.none(), strategy)


@st.composite
def _trials(draw) -> Trial:
    n = draw(st.integers(1, 50))
    signal = st.lists(_number, min_size=n, max_size=n).map(np.array)
    cuts = sorted(draw(st.sets(st.integers(0, n), min_size=2, max_size=7)))
    names = st.sampled_from(["approach", "dwell", "ramp", "hold", "retract", "clear", "sweep"])
    phases = tuple(Phase(draw(names), a, b) for a, b in pairwise(cuts))
    native = None
    if draw(st.booleans()):
        times = np.cumsum(draw(st.lists(st.floats(1e-6, 1.0), min_size=3, max_size=9)))
        native = NativeSamples(times, times * 2, times * 3)
    return Trial(
        trial_id=draw(_text.filter(str.strip)),
        started=draw(st.datetimes()).isoformat(),
        kind=draw(st.sampled_from(["ramp_hold_retract", "air_sweep", "rigid_target", "force_calibration"])),
        source=draw(st.sampled_from(["nidaqmx", "simulated", "imported"])),
        status=draw(st.sampled_from(["complete", "aborted", "recovered"])),
        sample_rate_hz=draw(_positive),
        position_v=draw(signal),
        force_v=draw(signal),
        command_v=draw(_maybe(signal)),
        calibration=Calibration(
            *(draw(s) for s in (_slope, _number, _slope, _number, _slope, _number)),
            calibrated=draw(_text),
            standard_errors=draw(st.dictionaries(st.sampled_from(["volts_per_mn"]), st.floats(0, 1e9))),
        ),
        phases=phases,
        status_reason=draw(_text),
        software="x",
        software_version="y",
        surface=draw(_maybe(st.builds(Surface, _number, st.integers(-1, 10**12), _number, _number))),
        protocol=ProtocolSummary(draw(_maybe(st.floats(0, 1e9))), hold_s=2.0, toml=draw(_text)),
        specimen=Specimen(
            draw(_text), draw(st.sampled_from(["", "thumb"])), repeat=draw(_maybe(st.integers(0, 99)))
        ),
        events=tuple(
            draw(st.lists(st.builds(Event, st.integers(0, 10**9), _text.filter(bool), _text), max_size=4))
        ),
        log=tuple(draw(st.lists(_text, max_size=4))),
        discarded=draw(_text),
        native=native,
        other_channels=draw(st.dictionaries(st.sampled_from(["force_command_mn", "b"]), signal)),
    )


@given(trial=_trials())
@settings(max_examples=80, deadline=None)
def test_what_is_written_is_read_back(trial, tmp_path_factory, assert_same_trial):
    path = tmp_path_factory.mktemp("trial") / "trial.h5"
    write_trial(path, trial)
    read = read_trial(path)
    assert_same_trial(read, trial)
    assert read.path == str(path)


def test_every_field_has_its_place_in_the_table():
    for group, part in (
        ("/surface", Surface),
        ("/protocol", ProtocolSummary),
        ("/specimen", Specimen),
        ("/calibration", Calibration),
    ):
        declared = {a.name for a in attributes_of(group) if not a.name.endswith("_se")}
        assert declared == {field.name for field in fields(part)} - {"toml", "standard_errors"}
    assert len({(a.group, a.name) for a in ATTRIBUTES}) == len(ATTRIBUTES)


def test_the_layout_is_the_contracts(tmp_path, a_trial):
    """Read with h5py alone, by the names of the contract."""
    trial = a_trial(100, log=("a", "b"))
    write_trial(tmp_path / "t.h5", trial)
    with h5py.File(tmp_path / "t.h5", "r") as file:
        root = dict(file.attrs)
        assert root.pop("format_version") == 1
        assert root == {
            "format": "indenter-trial",
            "trial_id": trial.trial_id,
            "started": trial.started,
            "software": "indenter",
            "software_version": "0.1",
            "status": "complete",
            "status_reason": "",
            "kind": "ramp_hold_retract",
            "source": "simulated",
        }
        assert file["signals"].attrs["sample_rate_hz"] == 8000.0
        for name in ("position_v", "force_v", "command_v"):
            assert file[f"signals/{name}"].shape == (100,)
            assert file[f"signals/{name}"].dtype.kind == "f"
        assert dict(file["calibration"].attrs) == {
            "volts_per_mm": 2.05,
            "position_zero_v": -10.1,
            "volts_per_mn": 0.0151,
            "force_zero_v": 0.02,
            "command_volts_per_mm": 2.04,
            "command_zero_v": -10.05,
            "volts_per_mm_se": 1e-4,
            "calibrated": "2026-01-31T12:00:00+01:00",
        }
        assert file["phases"].dtype.names == ("name", "start", "stop")
        assert file["phases"].dtype["name"].kind == "S"
        assert file["phases"].dtype["start"] == file["phases"].dtype["stop"] == np.int64
        assert file["phases"][1].tolist() == (b"hold", 25, 100)
        assert dict(file["surface"].attrs) == {
            "position_mm": 5.1, "sample": 20, "overshoot_um": 3.5, "threshold_mn": 10.0,
        }  # fmt: skip
        assert dict(file["protocol"].attrs) == {"depth_mm": 0.4, "hold_s": 7.0}
        assert file["protocol/toml"][()] == b'name = "a"\n'
        assert dict(file["specimen"].attrs) == {
            "subject": "s1", "finger": "index", "site": "pad", "repeat": 2,
            "punch_diameter_mm": 0.5, "rest_s": 130.0, "notes": "né",
        }  # fmt: skip
        assert file["events"].dtype.names == ("sample", "kind", "message")
        assert file["events"][0].tolist() == (3, b"limit", "über 500 mN".encode())
        assert [line.decode() for line in file["log"]] == ["a", "b"]


def test_units_follow_from_volts_and_constants(tmp_path, a_trial):
    write_trial(tmp_path / "t.h5", a_trial())
    trial = read_trial(tmp_path / "t.h5")
    np.testing.assert_allclose(trial.position_mm, (trial.position_v + 10.1) / 2.05)
    np.testing.assert_allclose(trial.force_mn, (trial.force_v - 0.02) / 0.0151)
    np.testing.assert_allclose(trial.command_mm, (trial.command_v + 10.05) / 2.04)
    assert trial.time_s[8] == 0.001


def test_another_programs_file_is_read(foreign_file):
    trial = read_trial(foreign_file())
    assert (trial.software, trial.software_version, trial.source) == ("other", "2", "nidaqmx")
    assert trial.n_samples == 100
    assert trial.command_v is None
    assert trial.force_mn[10] == 5.0
    assert [phase.name for phase in trial.phases] == ["approach", "ramp", "hold"]  # the empty one is dropped
    assert trial.events == trial.log == ()
    assert trial.surface is None


def _without(name):
    def change(file):
        group, _, attribute = name.rpartition("/")
        if attribute in (file[group] if group else file).attrs:
            del (file[group] if group else file).attrs[attribute]
        else:
            del file[name]

    return change


def _with(name, value):
    def change(file):
        group, _, attribute = name.rpartition("/")
        file[group or "/"].attrs[attribute] = value

    return change


def _added(group, attribute, value):
    return lambda file: file.create_group(group).attrs.__setitem__(attribute, value)


def _signal(name, values):
    def change(file):
        del file[f"signals/{name}"]
        file[f"signals/{name}"] = values

    return change


def _phases(*rows):
    def change(file):
        del file["phases"]
        file["phases"] = np.array(list(rows), dtype=[("name", "S9"), ("start", "i8"), ("stop", "i8")])

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (_with("format", "something"), "/format is 'something'"),
        (_with("format_version", 2), "/format_version is 2"),
        (_with("format_version", "one"), "/format_version is 'one'"),
        (_with("status", "done"), "/status is 'done'"),
        (_with("kind", "poke"), "/kind is 'poke'"),
        (_with("kind", b"\xff\xfe"), "/kind is not UTF-8"),
        (_with("source", 3), "/source is not a text"),
        (_with("started", "yesterday"), "/started is 'yesterday'"),
        (_with("trial_id", " "), "/trial_id is ' '"),
        (_with("signals/sample_rate_hz", 0.0), "/signals/sample_rate_hz is 0.0"),
        (_with("signals/sample_rate_hz", -8000.0), "/signals/sample_rate_hz is -8000.0"),
        (_with("signals/sample_rate_hz", np.nan), "/signals/sample_rate_hz is nan"),
        (_with("signals/sample_rate_hz", "8 kHz"), "/signals/sample_rate_hz is '8 kHz'"),
        (_with("signals/sample_rate_hz", [1.0, 2.0]), "/signals/sample_rate_hz is"),
        (_with("calibration/volts_per_mm", 0.0), "/calibration/volts_per_mm is 0.0"),
        (_with("calibration/volts_per_mn", np.inf), "/calibration/volts_per_mn is inf"),
        (_with("calibration/force_zero_v", np.nan), "/calibration/force_zero_v is nan"),
        (_with("calibration/volts_per_mm_se", -1.0), "/calibration/volts_per_mm_se is -1.0"),
        (_without("calibration/volts_per_mm"), "/calibration/volts_per_mm is missing"),
        (_without("calibration"), "/calibration is missing"),
        (_without("format"), "/format is missing"),
        (_without("kind"), "/kind is missing"),
        (_without("signals"), "/signals is missing"),
        (_without("signals/sample_rate_hz"), "/signals/sample_rate_hz is missing"),
        (_without("signals/force_v"), "/signals/force_v is missing"),
        (_without("phases"), "/phases is missing"),
        (_signal("force_v", np.arange(99)), "differ in length (position_v 100, force_v 99)"),
        (_signal("force_v", np.full(100, np.nan)), "/signals/force_v is nan at sample 0 (100 such)"),
        (_signal("force_v", np.where(np.arange(100) == 7, np.inf, 0)), "is inf at sample 7 (1 such)"),
        (_signal("force_v", np.zeros((10, 10))), "/signals/force_v is not a 1-D array"),
        (_signal("force_v", np.array([b"a"] * 100)), "/signals/force_v is not a 1-D array"),
        (
            lambda f: f["signals"].create_dataset("command_v", data=np.zeros(100)),
            "/calibration/command_volts_per_mm is missing",
        ),
        (_phases((b"hold", 0, 101)), "/phases row 0 (hold) runs from 0 to 101"),
        (_phases((b"hold", -1, 5)), "/phases row 0 (hold) runs from -1 to 5"),
        (_phases((b"hold", 9, 5)), "/phases row 0 (hold) runs from 9 to 5"),
        (_phases((b"ramp", 0, 50), (b"hold", 40, 100)), "/phases row 1 (hold) runs from 40 to 100"),
        (_phases((b"wait", 0, 50)), "/phases row 0 is named 'wait'"),
        (_phases((b"\xe9", 0, 50)), "/phases row 0 is not UTF-8"),
        (_added("specimen", "finger", "toe"), "/specimen/finger is 'toe'"),
        (_added("specimen", "repeat", 1.5), "/specimen/repeat is 1.5"),
        (_added("protocol", "depth_mm", -0.4), "/protocol/depth_mm is -0.4"),
        (_added("protocol", "hold_s", np.nan), "/protocol/hold_s is nan"),
        (lambda f: f.create_group("surface"), "/surface/position_mm is missing"),
        (lambda f: f.create_dataset("protocol/toml", data=3.0), "/protocol/toml is not a text"),
        (lambda f: f.create_dataset("events", data=np.zeros(3)), "/events is not a table"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_in_one_line(foreign_file, change, words):
    path = foreign_file(change)
    with pytest.raises(BadInputError) as caught:
        read_trial(path)
    message = str(caught.value)
    assert words in message
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert message.count(": ") >= 2  # which file, what, what to do


def test_a_running_file_of_another_program_may_end_in_nothing(foreign_file):
    def change(file):
        file.attrs["status"] = "running"
        file["signals/position_v"][60:] = np.nan

    trial = read_trial(foreign_file(change))
    assert (trial.status, trial.n_samples) == ("running", 60)
    assert trial.phases[-1] == Phase("hold", 40, 60)


def test_relative_paths_mean_the_folder_of_the_moment(foreign_file, tmp_path, monkeypatch):
    foreign_file(name="good.h5")
    foreign_file(_with("kind", "poke"), name="bad.h5")
    for folder in (tmp_path, tmp_path.parent):
        monkeypatch.chdir(folder)
        name = (tmp_path / "good.h5").relative_to(folder)
        assert read_trial(name).n_samples == 100
        with pytest.raises(BadInputError, match=f"^{name.with_name('bad.h5')}: /kind is 'poke'"):
            read_trial(name.with_name("bad.h5"))


def test_files_that_are_none(tmp_path, a_trial):
    cases = {"empty.h5": b"", "text.h5": b"time_s,position_mm\n0,1\n", "short.h5": b"\x89HDF\r\n\x1a\n"}
    words = {"empty.h5": "is empty", "text.h5": "is not an HDF5 file", "short.h5": "HDF5"}
    for name, contents in cases.items():
        (tmp_path / name).write_bytes(contents)
        with pytest.raises(BadInputError, match=words[name]):
            read_trial(tmp_path / name)
    with pytest.raises(BadInputError, match="is a folder"):
        read_trial(tmp_path)
    with pytest.raises(BadInputError, match="no such file"):
        read_trial(tmp_path / "none.h5")
    write_trial(tmp_path / "t.h5", a_trial())
    whole = (tmp_path / "t.h5").read_bytes()
    (tmp_path / "t.h5").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(BadInputError, match="cut short after"):
        read_trial(tmp_path / "t.h5")


def test_a_trial_that_would_not_be_read_is_not_written(tmp_path, a_trial):
    path = tmp_path / "t.h5"
    for changes in (
        {"force_v": np.zeros(3)},
        {"force_v": np.full(400, np.nan)},
        {"phases": (Phase("hold", 0, 401),)},
        {"phases": (Phase("wait", 0, 4),)},
        {"sample_rate_hz": 0.0},
        {"kind": "poke"},
    ):
        with pytest.raises(BadInputError):
            write_trial(path, a_trial(**changes))
    assert not list(tmp_path.iterdir())
    with pytest.raises(BadInputError, match="can't be written"):
        write_trial(tmp_path / "no such folder" / "t.h5", a_trial())


def test_stray_characters_do_not_stop_a_recording(tmp_path, a_trial):
    write_trial(tmp_path / "t.h5", a_trial(log=("a\0b", "c\ud800"), events=(Event(1, "k", "x\0"),)))
    trial = read_trial(tmp_path / "t.h5")
    assert trial.log == ("a\ufffdb", "c?")
    assert trial.events[0].message == "x\ufffd"


def test_a_discarded_trial_keeps_its_recording(tmp_path, a_trial, assert_same_trial):
    path = tmp_path / "t.h5"
    trial = a_trial()
    write_trial(path, trial)
    mark_discarded(path, "finger moved")
    assert_same_trial(read_trial(path), a_trial(discarded="finger moved"))
    with h5py.File(path) as file:
        assert file.attrs["discarded"] == "finger moved"
    with pytest.raises(BadInputError, match="needs a reason"):
        mark_discarded(path, " ")
    assert [p.name for p in tmp_path.iterdir()] == ["t.h5"]


def test_finding_trials(tmp_path, a_trial):
    study = tmp_path / "study" / "s1"
    study.mkdir(parents=True)
    for name in ("b.h5", "a.h5", ".a.h5.1.part", "notes.txt", ".hidden.h5"):
        (study / name).write_bytes(b"x")
    assert find_trials([tmp_path]) == [study / "a.h5", study / "b.h5"]
    assert find_trials([study / "b.h5", study]) == [study / "a.h5", study / "b.h5"]
    with pytest.raises(BadInputError, match="no such file"):
        find_trials([tmp_path / "none"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadInputError, match="holds no trial files"):
        find_trials([tmp_path / "empty"])


def test_importing_the_package_loads_nothing_heavy():
    code = "import sys, analysis.recordings; sys.exit('h5py' in sys.modules or 'numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_package_names_what_it_offers():
    from analysis import recordings

    for name in recordings.__all__:
        assert callable(getattr(recordings, name))
    with pytest.raises(AttributeError, match="nothing"):
        _ = recordings.nothing


def test_paths_may_be_given_as_text(tmp_path: Path, a_trial):
    write_trial(str(tmp_path / "t.h5"), a_trial())
    assert read_trial(str(tmp_path / "t.h5")).n_samples == 400
