"""Cut-off trials are brought back, everything else is left alone."""

from __future__ import annotations

import os
import subprocess
import sys

import h5py
import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.recordings import TrialWriter, read_trial, write_trial
from analysis.recordings.live.rescue import rescue_paths
from analysis.recordings.trial import Event, Phase, ProtocolSummary

RATE = 8000.0
# at rest, approach, dwell, ramp, hold, retract, clear: position in mm at time in s
TIMES = (0.0, 0.1, 2.1, 4.1, 4.18, 7.18, 7.6, 8.0)
PLACES = (3.0, 3.0, 5.0, 5.0, 5.4, 5.4, 3.3, 3.3)
PHASES = tuple(
    Phase(name, round(RATE * start), round(RATE * stop))
    for name, start, stop in (
        ("approach", 0.0, 2.1),
        ("dwell", 2.1, 4.1),
        ("ramp", 4.1, 4.18),
        ("hold", 4.18, 7.18),
        ("retract", 7.18, 7.6),
        ("clear", 7.6, 8.0),
    )
)


def _cut_off(path, header, n_samples, phases=()):
    """A trial whose process ended, without a word, after n_samples."""
    command_mm = np.interp(np.arange(n_samples) / RATE, TIMES, PLACES)
    position_mm = command_mm + np.random.default_rng(0).normal(0, 2.5e-4, n_samples)
    c = header.calibration
    writer = TrialWriter(path, header, 70_000)
    writer.append(
        c.position_zero_v + c.volts_per_mm * position_mm,
        np.zeros(n_samples) + 0.3,
        c.command_zero_v + c.command_volts_per_mm * command_mm,
    )
    writer.set_phases(phases)
    writer.add_event(Event(5, "note", "kept"))
    writer._close()


def test_a_cut_off_trial_is_recovered(tmp_path, a_header):
    path = tmp_path / "t.h5"
    _cut_off(path, a_header(log=("begun",), protocol=ProtocolSummary(0.4, toml="x = 1")), 40_000, PHASES)
    before = read_trial(path)
    (outcome,) = rescue_paths([tmp_path])
    assert (outcome.path, outcome.result) == (path, "recovered")
    assert "40000 samples" in outcome.action
    trial = read_trial(path)
    with h5py.File(path, "r") as file:
        assert file["signals/force_v"].shape == (40_000,)  # trimmed, for any other program too
    assert trial.status == "recovered"
    assert "cut off after 5.000 s" in trial.status_reason
    assert trial.phases == (*PHASES[:3], Phase("hold", 33440, 40000))
    np.testing.assert_array_equal(trial.position_v, before.position_v)
    assert trial.events == (Event(5, "note", "kept"),)
    assert trial.protocol == ProtocolSummary(0.4, toml="x = 1")
    assert trial.log[0] == "begun"
    assert "rescued by indenter" in trial.log[1]
    assert [p.name for p in tmp_path.iterdir()] == ["t.h5"]
    (again,) = rescue_paths([path])
    assert again.result == "left alone"


@pytest.mark.parametrize("n_samples", [10_000, 20_000, 33_000, 33_300, 50_000, 58_000, 59_500, 63_000])
@pytest.mark.parametrize("written", [1, 2, 3, 4])
def test_phases_that_were_not_written_are_found_from_the_motion(tmp_path, a_header, n_samples, written):
    """The run writes a phase when it begins; what it had not written yet follows from the command."""
    known = [phase for phase in PHASES[:written] if phase.start < n_samples]
    known[-1] = Phase(known[-1].name, known[-1].start, known[-1].start + 1)
    _cut_off(tmp_path / "t.h5", a_header(), n_samples, tuple(known))
    rescue_paths([tmp_path])
    trial = read_trial(tmp_path / "t.h5")
    expected = [phase for phase in PHASES if phase.start < n_samples]
    assert [phase.name for phase in trial.phases] == [phase.name for phase in expected]
    assert trial.phases[-1].stop == n_samples
    for found, true in zip(trial.phases, expected, strict=True):
        assert abs(found.start - true.start) <= 40  # 5 ms


def test_without_any_phase_only_what_the_protocol_confirms_is_claimed(tmp_path, a_header):
    protocol = ProtocolSummary(depth_mm=0.4)
    for name, n_samples in (("dwelling.h5", 30_000), ("holding.h5", 50_000)):
        _cut_off(tmp_path / name, a_header(protocol=protocol), n_samples)
    _cut_off(tmp_path / "unknown.h5", a_header(), 50_000)
    rescue_paths([tmp_path])
    assert read_trial(tmp_path / "dwelling.h5").phases == ()
    assert read_trial(tmp_path / "unknown.h5").phases == ()
    assert [p.name for p in read_trial(tmp_path / "holding.h5").phases] == [
        "approach",
        "dwell",
        "ramp",
        "hold",
    ]


def test_a_row_half_written_at_the_kill_does_no_harm(tmp_path, a_header):
    path = tmp_path / "t.h5"
    _cut_off(path, a_header(), 40_000, PHASES[:4])
    with h5py.File(path, "r+") as file:
        rows = file["phases"][()]
        rows[3]["stop"], rows[4]["name"] = 7, b"retr\xff"
        file["phases"][...] = rows
        events = file["events"][()]
        events[1]["kind"], events[1]["message"] = b"limit", b"\xc3"
        file["events"][...] = events
    trial = read_trial(path)
    assert trial.phases == PHASES[:3]
    assert trial.events == (Event(5, "note", "kept"),)
    rescue_paths([path])
    assert [p.name for p in read_trial(path).phases] == ["approach", "dwell", "ramp", "hold"]


def test_leftovers_of_a_killed_process_are_cleared(tmp_path, a_trial):
    write_trial(tmp_path / "t.h5", a_trial())
    old, new = tmp_path / ".t.h5.11.part", tmp_path / ".t.h5.12.part"
    old.write_bytes(b"x")
    new.write_bytes(b"x")
    os.utime(old, (1e9, 1e9))
    rescue_paths([tmp_path])
    assert sorted(p.name for p in tmp_path.iterdir()) == [".t.h5.12.part", "t.h5"]


def test_an_air_sweep_is_one_sweep(tmp_path, a_header):
    _cut_off(tmp_path / "t.h5", a_header(kind="air_sweep"), 3000)
    rescue_paths([tmp_path])
    assert read_trial(tmp_path / "t.h5").phases == (Phase("sweep", 0, 3000),)


def test_good_and_bad_files_in_one_folder(tmp_path, a_header, a_trial):
    write_trial(tmp_path / "a_whole.h5", a_trial())
    (tmp_path / "b_junk.h5").write_bytes(b"junk")
    _cut_off(tmp_path / "c_cut.h5", a_header(), 9000, PHASES)
    empty = TrialWriter(tmp_path / "d_empty.h5", a_header(), 100)
    empty._close()
    untouched = {p: p.read_bytes() for p in tmp_path.iterdir() if p.name[0] in "abd"}
    outcomes = rescue_paths([tmp_path])
    assert [o.result for o in outcomes] == ["left alone", "unreadable", "recovered", "unreadable"]
    assert all("\n" not in o.action for o in outcomes)
    assert "is not an HDF5 file" in outcomes[1].action
    assert "no samples" in outcomes[3].action
    assert all(path.read_bytes() == contents for path, contents in untouched.items())
    with pytest.raises(BadInputError, match="no such file"):
        rescue_paths([tmp_path / "none"])


def test_what_the_layout_does_not_know_is_kept(tmp_path, foreign_file):
    def change(file):
        file.attrs["status"] = "running"
        file["camera/frames"] = np.arange(5)
        file["signals"].attrs["gain"] = 2.0

    path = foreign_file(change)
    (outcome,) = rescue_paths([path])
    assert outcome.result == "recovered"
    with h5py.File(path, "r") as file:
        assert file.attrs["colour"] == "green"
        assert file["camera/frames"].shape == (5,)
        assert file["signals/temperature_v"].shape == (100,)
        assert file["signals"].attrs["gain"] == 2.0


def test_a_file_that_lost_its_end_keeps_what_it_has(tmp_path, a_trial):
    whole = a_trial(20_000, phases=(Phase("approach", 0, 900), Phase("hold", 900, 20_000)))
    path = tmp_path / "t.h5"
    write_trial(path, whole)
    contents = path.read_bytes()[:-50_000]
    path.write_bytes(contents)
    with pytest.raises(BadInputError, match=r"cut short after .*`indenter rescue`"):
        read_trial(path)
    (outcome,) = rescue_paths([path])
    assert outcome.result == "recovered"
    assert (tmp_path / "t.h5.cut").read_bytes() == contents
    trial = read_trial(path)
    n = trial.n_samples
    assert 13_000 < n < 20_000  # 50 kB are 6250 samples of the last channel
    np.testing.assert_array_equal(trial.command_v, whole.command_v[:n])
    np.testing.assert_array_equal(trial.position_v, whole.position_v[:n])
    assert trial.phases == (Phase("approach", 0, 900), Phase("hold", 900, n))
    assert trial.status == "recovered"
    path.write_bytes(contents[:3000])
    (outcome,) = rescue_paths([path])
    assert outcome.result == "unreadable"
    assert path.read_bytes() == contents[:3000]


WRITER = """
import sys, time
from pathlib import Path
from analysis.recordings import TrialHeader, TrialWriter
from analysis.recordings.trial import Calibration

header = TrialHeader("air_sweep", "simulated", 8000.0, Calibration(2.0, 0.0, 0.015, 0.0, 2.0, 0.0))
writer = TrialWriter(Path(sys.argv[1]), header, 800)
writer.append([1.0] * 9, [2.0] * 9, [3.0] * 9)
print("ready", flush=True)
time.sleep(60)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="an open file can't be replaced there")
def test_a_trial_that_is_being_written_is_left_alone(tmp_path):
    path = tmp_path / "t.h5"
    child = subprocess.Popen([sys.executable, "-c", WRITER, path], stdout=subprocess.PIPE, text=True)
    try:
        assert child.stdout is not None
        child.stdout.readline()
        (outcome,) = rescue_paths([path])
        assert outcome.result == "left alone"
        assert "being written" in outcome.action
    finally:
        child.kill()
        child.communicate()
    (outcome,) = rescue_paths([path])
    assert outcome.result == "recovered"
