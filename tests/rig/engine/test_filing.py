"""The road from card to file: it waits for nobody, nobody waits for it, and nothing is lost on it."""

from __future__ import annotations

import errno
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from analysis.recordings import TrialHeader, TrialWriter, read_trial
from analysis.recordings.trial import Calibration, Phase
from rig.engine.errors import DiskSilentError, FilingError
from rig.engine.filing import Filing, TrialFile
from rig.hardware.lever import Chunk

CALIBRATION = Calibration(2.0, -10.0, 0.015, 0.0, 2.0, -10.0)


def a_writer(folder: Path) -> TrialWriter:
    return TrialWriter(folder / "t.h5", TrialHeader("air_sweep", "simulated", 8000.0, CALIBRATION), 1000)


def chunk(start: int, n: int = 40) -> Chunk:
    i = np.arange(start, start + n, dtype=np.float64)
    return Chunk(start, i, -i, 2 * i, CALIBRATION)


def test_samples_reach_the_file_while_the_program_does_something_else(tmp_path: Path) -> None:
    with a_writer(tmp_path) as writer, Filing(writer) as filing:
        for start in range(0, 400, 40):
            filing.keep(chunk(start))
        deadline = time.monotonic() + 5
        while writer.n_samples < 400 and time.monotonic() < deadline:
            time.sleep(0.001)
        assert read_trial(tmp_path / "t.h5").n_samples == 400
    trial = read_trial(tmp_path / "t.h5")
    assert trial.command_v is not None
    np.testing.assert_array_equal(trial.position_v, np.arange(400))
    np.testing.assert_array_equal(trial.force_v, -np.arange(400))
    np.testing.assert_array_equal(trial.command_v, 2 * np.arange(400))


def test_what_follows_the_end_of_the_trial_is_left_out(tmp_path: Path) -> None:
    with a_writer(tmp_path) as writer, Filing(writer) as filing:
        filing.keep(chunk(0))
        filing.keep(chunk(40))
        filing.end(60)
        filing.end()
        filing.keep(chunk(80))
    assert read_trial(tmp_path / "t.h5").n_samples == 60


def test_of_a_trial_cut_short_everything_is_kept(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), a_writer(tmp_path) as writer, Filing(writer) as filing:
        for start in range(0, 800, 8):
            filing.keep(chunk(start, 8))
        raise RuntimeError("stopped")
    trial = read_trial(tmp_path / "t.h5")
    assert (trial.status, trial.n_samples) == ("aborted", 800)


def test_the_command_is_put_right_where_it_was_known_too_late(tmp_path: Path) -> None:
    with a_writer(tmp_path) as writer, Filing(writer) as filing:
        filing.keep(chunk(0))
        filing.end(None, np.full(30, 7.0))
    command_v = read_trial(tmp_path / "t.h5").command_v
    assert command_v is not None
    np.testing.assert_array_equal(command_v, [7.0] * 30 + [2.0 * i for i in range(30, 40)])


def test_nobody_waits_for_a_slow_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = threading.Event()
    writer = a_writer(tmp_path)
    append = writer.append

    def slow(*channels: np.ndarray) -> None:
        assert disk.wait(10)
        append(*channels)

    monkeypatch.setattr(writer, "append", slow)
    with writer, Filing(writer) as filing:
        for start in range(0, 4000, 40):
            filing.keep(chunk(start))
        filing.check()
        filing.end()
        assert writer.n_samples == 0
        disk.set()
    assert read_trial(tmp_path / "t.h5").n_samples == 4000


def test_what_is_noted_waits_for_the_disk_and_nobody_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = threading.Event()
    writer = a_writer(tmp_path)
    append = writer.append
    monkeypatch.setattr(writer, "append", lambda *channels: disk.wait(10) and append(*channels))
    with writer, Filing(writer) as filing:
        filing.keep(chunk(0))
        filing.note(lambda: writer.set_phases([Phase("approach", 0, 30)]))
        filing.end()
        filing.note(lambda: writer.set_phases([Phase("approach", 0, 20)]))
        assert writer.phases == ()
        disk.set()
    assert read_trial(tmp_path / "t.h5").phases == (Phase("approach", 0, 20),)


def test_a_disk_that_hangs_is_told_and_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = threading.Event()
    writer = a_writer(tmp_path)
    writer.append([1.0], [2.0], [3.0])
    monkeypatch.setattr(writer, "append", lambda *_: disk.wait(60))
    monkeypatch.setattr(writer, "finish", lambda *_: pytest.fail("more was asked of the disk"))
    with (
        pytest.raises(DiskSilentError, match=r"taken nothing for 0.2 s.*indenter rescue"),
        TrialFile(writer),
        Filing(writer, patience_s=0.2) as filing,
    ):
        filing.keep(chunk(0))
    disk.set()
    assert read_trial(tmp_path / "t.h5").n_samples == 1
    writer._close()


def test_a_full_disk_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = a_writer(tmp_path)
    writer.append([1.0], [2.0], [3.0])

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(writer, "append", full)
    with (
        pytest.raises(FilingError, match=r"No space left.*indenter rescue"),
        writer,
        Filing(writer) as filing,
    ):
        filing.keep(chunk(0))
        deadline = time.monotonic() + 5
        while time.monotonic() < deadline:
            filing.check()
            time.sleep(0.001)
    assert read_trial(tmp_path / "t.h5").status == "aborted"
    with pytest.raises(FilingError, match=r"No space left.*indenter rescue"), Filing(writer) as filing:
        filing.keep(chunk(0))
