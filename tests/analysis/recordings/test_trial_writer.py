"""The writer of a running trial: readable at every moment, whatever ends it."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import h5py
import numpy as np
import pytest

from analysis.errors import BadInputError
from analysis.recordings import TrialWriter, mark_discarded, read_trial, write_trial
from analysis.recordings.live.locking import is_locked
from analysis.recordings.live.rescue import recovered_trial
from analysis.recordings.trial import Event, Phase, Surface

RNG = np.random.default_rng(5)


def _append_all(writer, signals, chunk=40):
    for start in range(0, signals.shape[1], chunk):
        writer.append(*signals[:, start : start + chunk])


def test_chunks_phases_and_events_come_back(tmp_path, a_header):
    signals = RNG.normal(size=(3, 1003))
    phases = (Phase("approach", 0, 500), Phase("dwell", 500, 2000))
    with TrialWriter(tmp_path / "t.h5", a_header(log=("a", "b")), 2000) as writer:
        _append_all(writer, signals)
        writer.set_phases(phases)
        writer.add_event(Event(17, "limit", "ö" * 300))
        writer.set_surface(Surface(5.0, 400, 2.0, 10.0))
    trial = read_trial(tmp_path / "t.h5")
    np.testing.assert_array_equal([trial.position_v, trial.force_v, trial.command_v], signals)
    assert trial.status == "complete"
    assert trial.phases == (Phase("approach", 0, 500), Phase("dwell", 500, 1003))
    assert trial.events == (Event(17, "limit", "ö" * 300),)
    assert trial.surface == Surface(5.0, 400, 2.0, 10.0)
    assert trial.log == ("a", "b")
    assert [p.name for p in tmp_path.iterdir()] == ["t.h5"]


def test_a_running_file_is_read_by_any_hdf5_program_at_any_moment(tmp_path, a_header):
    signals = RNG.normal(size=(3, 400))
    writer = TrialWriter(tmp_path / "t.h5", a_header(), 500)
    try:
        for start in range(0, 400, 40):
            writer.append(*signals[:, start : start + 40])
            writer.set_phases((Phase("approach", 0, start + 1),))
            with h5py.File(tmp_path / "t.h5", "r") as file:
                written = file["signals/force_v"][()]
                assert file.attrs["status"] == "running"
            np.testing.assert_array_equal(written[: start + 40], signals[1, : start + 40])
            assert np.isnan(written[start + 40 :]).all()
        trial = read_trial(tmp_path / "t.h5")
        assert (trial.n_samples, trial.status) == (400, "running")
        assert trial.phases == (Phase("approach", 0, 361),)
    finally:
        writer.finish("aborted", "end of test")
    assert read_trial(tmp_path / "t.h5").status_reason == "end of test"


def test_a_trial_may_outgrow_its_capacity(tmp_path, a_header):
    signals = RNG.normal(size=(3, 5000))
    with TrialWriter(tmp_path / "t.h5", a_header(), 64) as writer:
        for i in range(300):
            writer.add_event(Event(i, "tick", str(i)))
        _append_all(writer, signals, 70)
        assert read_trial(tmp_path / "t.h5").n_samples == 5000
    trial = read_trial(tmp_path / "t.h5")
    np.testing.assert_array_equal([trial.position_v, trial.force_v, trial.command_v], signals)
    assert [event.message for event in trial.events] == [str(i) for i in range(300)]


def test_chunks_go_on_while_the_structure_changes(tmp_path, a_header):
    """One thread appends, beyond the capacity as well, while another finds the surface and notes events."""
    appended = 0
    done = threading.Event()

    def append() -> None:
        nonlocal appended
        while not done.is_set():
            i = np.arange(appended, appended + 40.0)
            writer.append(i, -i, 2 * i)
            appended += 40

    with TrialWriter(tmp_path / "t.h5", a_header(), 800) as writer, ThreadPoolExecutor(1) as other:
        appending = other.submit(append)
        try:
            for i in range(25):
                writer.set_surface(Surface(5.0, i, 2.0, 10.0))
                writer.set_phases((Phase("approach", 0, i + 1),))
                for j in range(10):
                    writer.add_event(Event(i, "tick", f"{i} {j}"))
                running = read_trial(tmp_path / "t.h5")
                assert running.phases == (Phase("approach", 0, i + 1),)
                assert len(running.events) == 10 * (i + 1)
        finally:
            done.set()
        appending.result()
    trial = read_trial(tmp_path / "t.h5")
    assert trial.n_samples == appended
    np.testing.assert_array_equal(trial.position_v, np.arange(appended))
    np.testing.assert_array_equal(trial.force_v, -np.arange(appended))
    np.testing.assert_array_equal(trial.command_v, 2 * np.arange(appended))


def test_a_chunk_does_not_wait_for_the_structure(tmp_path, a_header, monkeypatch):
    appended = threading.Event()
    with TrialWriter(tmp_path / "t.h5", a_header(), 10) as writer, ThreadPoolExecutor(1) as other:
        structure = writer._structure

        def slow(*args):
            other.submit(writer.append, [1.0], [2.0], [3.0]).add_done_callback(lambda _: appended.set())
            assert appended.wait(10)
            return structure(*args)

        monkeypatch.setattr(writer, "_structure", slow)
        writer._restructure()
    assert read_trial(tmp_path / "t.h5").n_samples == 1


def test_nothing_is_rewritten_where_the_surface_is_found(tmp_path, a_header):
    path, surface = tmp_path / "t.h5", Surface(5.0, 400, 2.0, 10.0)
    with TrialWriter(path, a_header(), 1000, grow=False) as writer:
        made = path.stat().st_ino
        _append_all(writer, RNG.normal(size=(3, 500)))
        writer.set_surface(surface)
        writer.set_phases((Phase("approach", 0, 400),))
        assert path.stat().st_ino == made
        running = read_trial(path)
        assert running.surface == surface
        assert recovered_trial(running).surface == surface
    trial = read_trial(path)
    assert trial.surface == surface
    with h5py.File(path) as file:
        assert "running" not in file


def test_a_trial_that_may_not_grow_is_refused_and_kept(tmp_path, a_header):
    with (
        pytest.raises(OSError, match="longer than the 100 samples"),
        TrialWriter(tmp_path / "t.h5", a_header(), 100, grow=False) as writer,
    ):
        _append_all(writer, RNG.normal(size=(3, 200)))
    trial = read_trial(tmp_path / "t.h5")
    assert (trial.status, trial.n_samples) == ("aborted", 80)


def test_a_file_that_another_program_cuts_is_never_complete(tmp_path, a_header):
    path = tmp_path / "t.h5"
    with (
        pytest.raises(OSError, match="another program"),
        TrialWriter(path, a_header(), 1000) as writer,
    ):
        _append_all(writer, RNG.normal(size=(3, 200)))
        os.truncate(path, path.stat().st_size - 20_000)
        writer.append([1.0], [2.0], [3.0])


def test_the_trial_of_a_folder_that_is_gone_is_kept_elsewhere(tmp_path, a_header, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    folder = tmp_path / "study"
    folder.mkdir()
    with (
        pytest.raises(BadInputError, match="its folder is gone: the trial was kept as"),
        TrialWriter(folder / "t.h5", a_header(), 1000) as writer,
    ):
        _append_all(writer, RNG.normal(size=(3, 200)))
        shutil.rmtree(folder)
    kept = read_trial(next(tmp_path.glob("t-*.h5")))
    assert (kept.status, kept.n_samples) == ("aborted", 200)


def test_without_a_command_channel(tmp_path, a_header):
    with TrialWriter(tmp_path / "t.h5", a_header(), 10, commanded=False) as writer:
        writer.append([1.0, 2.0], [3.0, 4.0])
    assert read_trial(tmp_path / "t.h5").command_v is None


def test_an_exception_leaves_an_aborted_trial(tmp_path, a_header):
    with pytest.raises(RuntimeError), TrialWriter(tmp_path / "t.h5", a_header(), 10) as writer:
        writer.append([1.0], [2.0], [3.0])
        raise RuntimeError("card gone:\nunplugged")
    trial = read_trial(tmp_path / "t.h5")
    assert (trial.status, trial.status_reason) == ("aborted", "RuntimeError: card gone: unplugged")


def test_a_trial_without_samples_leaves_no_file(tmp_path, a_header):
    with pytest.raises(BadInputError, match="nothing was recorded"):
        TrialWriter(tmp_path / "t.h5", a_header(), 10).finish()
    with pytest.raises(RuntimeError), TrialWriter(tmp_path / "t.h5", a_header(), 10):
        raise RuntimeError
    assert not list(tmp_path.iterdir())


def test_a_trial_never_overwrites_another(tmp_path, a_header):
    (tmp_path / "t.h5").write_bytes(b"precious")
    with pytest.raises(BadInputError, match="exists already"):
        TrialWriter(tmp_path / "t.h5", a_header(), 10)
    with pytest.raises(BadInputError, match="can't be made"):
        TrialWriter(tmp_path / "none" / "t.h5", a_header(), 10)
    assert [(p.name, p.read_bytes()) for p in tmp_path.iterdir()] == [("t.h5", b"precious")]


def test_a_header_that_could_not_be_read_is_refused_before_the_trial(tmp_path, a_header):
    for changes in ({"sample_rate_hz": float("nan")}, {"kind": "poke"}, {"started": "noon"}):
        with pytest.raises(BadInputError, match="it must"):
            TrialWriter(tmp_path / "t.h5", a_header(**changes), 10)
    assert not list(tmp_path.iterdir())


def test_wrong_chunks_and_phases_are_refused_and_do_no_harm(tmp_path, a_header):
    with TrialWriter(tmp_path / "t.h5", a_header(), 10) as writer:
        writer.append([1.0], [2.0], [3.0])
        for chunk in (([1.0], [2.0]), ([1.0], [2.0, 3.0], [4.0]), ([1.0], [np.nan], [2.0])):
            with pytest.raises(ValueError, match="chunk"):
                writer.append(*chunk)
        for phases in ((Phase("wait", 0, 1),), (Phase("hold", 5, 1),), (Phase("hold", 0, 1),) * 40):
            with pytest.raises(ValueError, match="phases"):
                writer.set_phases(phases)
        writer.append([1.0, 1.0], [2.0, 2.0], [3.0, 3.0])
        writer.drop_after(1)
        for command_v in ([1.0, 2.0], [np.nan]):
            with pytest.raises(ValueError, match="command"):
                writer.correct_command(command_v)
    with pytest.raises(ValueError, match="finished already"):
        writer.finish()
    with pytest.raises(ValueError, match="finished already"):
        writer.append([1.0], [2.0], [3.0])
    assert read_trial(tmp_path / "t.h5").n_samples == 1


CHILD = """
import sys, time, itertools
import numpy as np
from pathlib import Path
from analysis.recordings import TrialHeader, TrialWriter
from analysis.recordings.trial import Calibration, Event, Phase, Surface

calibration = Calibration(2.0, 0.0, 0.015, 0.0, 2.0, 0.0)
header = TrialHeader("ramp_hold_retract", "simulated", 8000.0, calibration)
writer = TrialWriter(Path(sys.argv[1]), header, 800)
print("start", flush=True)
for chunk in itertools.count():
    i = np.arange(40.0) + 40 * chunk
    writer.append(i, -i, 2 * i)
    if chunk % 7 == 0:
        writer.set_phases((Phase("approach", 0, 40 * chunk + 40),))
        writer.add_event(Event(40 * chunk, "tick", str(chunk)))
    if chunk == 11:
        writer.set_surface(Surface(1.0, 3, 1.0, 10.0))
    print(writer.n_samples, flush=True)
    time.sleep(0.0005)
"""


@pytest.mark.skipif(os.name == "nt", reason="kill -9 is POSIX")
def test_every_sample_written_survives_kill_9(tmp_path):
    """Capacity is outgrown, phases, events and surface change meanwhile; nothing acknowledged is lost."""
    rng = np.random.default_rng(1)
    for kill in range(6):
        path = tmp_path / f"{kill}.h5"
        with subprocess.Popen(
            [sys.executable, "-c", CHILD, path], stdout=subprocess.PIPE, text=True
        ) as child:
            try:
                assert child.stdout is not None
                assert child.stdout.readline() == "start\n"
                time.sleep(float(rng.uniform(0.0, 0.15)))
                assert is_locked(path)
            finally:
                child.kill()
            acknowledged = re.findall(r"\d+\n", child.stdout.read())
        assert not is_locked(path)
        with h5py.File(path, "r") as file:
            written = np.isfinite(file["signals/command_v"][()]).sum()
        at_least = int(acknowledged[-1]) if acknowledged else 0
        assert written >= at_least
        if written == 0:
            continue
        trial = read_trial(path)
        assert trial.n_samples >= at_least
        samples = np.arange(trial.n_samples)
        np.testing.assert_array_equal(trial.position_v, samples)
        np.testing.assert_array_equal(trial.force_v, -samples)
        np.testing.assert_array_equal(trial.command_v, 2 * samples)
        assert trial.phases[0].start == 0


MOVER = """
import sys
import numpy as np
from pathlib import Path
from analysis.recordings import TrialHeader, TrialWriter
from analysis.recordings.trial import Calibration

calibration = Calibration(2.0, 0.0, 0.015, 0.0, 2.0, 0.0)
writer = TrialWriter(Path(sys.argv[1]), TrialHeader("ramp_hold_retract", "simulated", 8000.0, calibration), 1)
print("running", flush=True)
for _ in sys.stdin:
    writer.append(*np.zeros((3, 2)))
    print("moved", flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="an open file can't be replaced there")
def test_a_file_that_moves_while_it_is_asked_for_its_lock_is_seen_to_be_locked(tmp_path, monkeypatch):
    """The old file, opened already, is given up once the larger one stands in its place."""
    path = tmp_path / "t.h5"
    lockf = os.lockf
    asked = []

    def moves_first(*wanted):
        asked.append(wanted)
        if len(asked) == 1:
            child.stdin.write("move\n")
            child.stdin.flush()
            assert child.stdout.readline() == "moved\n"
        return lockf(*wanted)

    command = [sys.executable, "-c", MOVER, path]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
        try:
            assert child.stdout.readline() == "running\n"
            monkeypatch.setattr(os, "lockf", moves_first)
            assert is_locked(path)
            assert len(asked) == 2
        finally:
            child.kill()


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of a file's size there")
def test_a_disk_that_takes_no_more_is_told_in_its_own_words(tmp_path, a_trial, a_header):
    """HDF5 is not let near it: after one refusal that library crashes, at the latest when the program ends."""
    import resource

    path = tmp_path / "t.h5"
    write_trial(path, a_trial(100))
    whole = path.read_bytes()
    before, hardest = resource.getrlimit(resource.RLIMIT_FSIZE)
    heeded = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(whole) + 4096, hardest))
    try:
        for write in (
            lambda: write_trial(path, a_trial(4000)),
            lambda: mark_discarded(path, "it moved"),
            lambda: TrialWriter(tmp_path / "new.h5", a_header(), 4000),
        ):
            with pytest.raises(BadInputError, match=r"h5: can't be (written|made) \(File too large\): check"):
                write()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (before, hardest))
        signal.signal(signal.SIGXFSZ, heeded)
    assert path.read_bytes() == whole
    assert [left.name for left in tmp_path.iterdir()] == ["t.h5"]
