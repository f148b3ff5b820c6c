"""Damaged files: a trial or one line, never another exception, a crash or a wait without end."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import psutil
import pytest

from analysis.errors import BadInputError
from analysis.recordings import probing, read_trial, write_trial
from analysis.recordings.trial import NativeSamples


def _damaged(contents: bytes, rng: random.Random) -> bytes:
    damaged = bytearray(contents)
    where = rng.randrange(len(damaged))
    match rng.choice(["bits", "bytes", "noise", "cut", "zeros", "moved", "inserted"]):
        case "bits":
            for _ in range(rng.choice([1, 2, 8, 64])):
                damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
        case "bytes":
            for _ in range(rng.choice([1, 4, 32])):
                damaged[rng.randrange(len(damaged))] = rng.choice([0, 255, rng.randrange(256)])
        case "noise":
            damaged[where : where + 64] = rng.randbytes(len(damaged[where : where + 64]))
        case "cut":
            del damaged[where:]
        case "zeros":
            damaged[where : where + 512] = bytes(len(damaged[where : where + 512]))
        case "moved":
            other = rng.randrange(len(damaged) - 64)
            damaged[other : other + 40] = damaged[where : where + 40]
        case "inserted":
            damaged[where:where] = rng.randbytes(rng.randrange(1, 16))
    return bytes(damaged)


def _read_all(path: Path, contents: bytes, count: int, seed: int) -> int:
    """Read `count` damaged versions of a file; return how many were refused."""
    rng = random.Random(seed)
    refused = 0
    for _ in range(count):
        path.write_bytes(_damaged(contents, rng))
        try:
            trial = read_trial(path)
        except BadInputError as error:
            refused += 1
            assert "\n" not in str(error)
            assert str(path) in str(error)
        else:
            assert trial.position_mm.shape == trial.force_mn.shape == trial.time_s.shape
            assert np.isfinite(trial.position_mm).all()
            assert np.isfinite(trial.force_mn).all()
            assert all(0 <= p.start < p.stop <= trial.n_samples for p in trial.phases)
    return refused


def _blank_file(tmp_path, a_trial) -> Path:
    path = tmp_path / "t.h5"
    native = NativeSamples(np.arange(5.0), np.zeros(5), np.zeros(5))
    write_trial(path, a_trial(100, native=native))
    return path


def test_damage_to_a_finished_file_is_always_seen(tmp_path, a_trial):
    """Its seal tells: 300 of 300 are refused, also those that only a sample would show."""
    path = _blank_file(tmp_path, a_trial)
    contents = path.read_bytes()
    read_trial(path)
    rng = random.Random(3)
    unchanged = sum(_damaged(contents, rng) == contents for _ in range(300))
    assert _read_all(path, contents, 300, seed=3) == 300 - unchanged


def test_damaged_files_without_a_seal(tmp_path, a_trial, monkeypatch):
    """As other programs write them: some are read, most are refused, the reading process lives."""
    monkeypatch.setattr(probing, "_READ_S", 1.0)
    path = _blank_file(tmp_path, a_trial)
    refused = _read_all(path, path.read_bytes()[:-25], 250, seed=4)
    assert 50 < refused < 250


@pytest.mark.parametrize("signature", [b"TREE", b"HEAP", b"SNOD"])
def test_a_damaged_list_of_names_is_told_as_what_it_is(tmp_path, a_trial, signature):
    """Of whichever group, the root included: the place is named, and no reader dies of it."""
    path = _blank_file(tmp_path, a_trial)
    contents = path.read_bytes()[:-25]
    parts = contents.split(signature)
    assert len(parts) > 3
    for k in range(1, len(parts)):
        path.write_bytes(signature.join(parts[:k]) + b"XXXX" + signature.join(parts[k:]))
        with pytest.raises(
            BadInputError, match=r"t\.h5: (/|the file's structure).* can't be read \("
        ) as caught:
            read_trial(path)
        assert "\n" not in str(caught.value)


def test_files_of_noise(tmp_path):
    rng = random.Random(5)
    for signature in (b"", b"\x89HDF\r\n\x1a\n", b"\x89HDF\r\n\x1a\n\0\0\0\0\0\x08\x08\0"):
        for _ in range(20):
            (tmp_path / "t.h5").write_bytes(signature + rng.randbytes(rng.randrange(1, 3000)))
            with pytest.raises(BadInputError):
                read_trial(tmp_path / "t.h5")


@pytest.mark.parametrize("ends", ["suspend", "kill"])
def test_a_file_on_which_the_reader_dies_is_one_line(tmp_path, monkeypatch, foreign_file, ends):
    """Whether it hangs on the file or is gone; the next file has a new process."""
    path = foreign_file()
    probe = probing.Probe()
    probe.check(path)
    reader = psutil.Process(probe._child.pid)
    getattr(reader, ends)()
    monkeypatch.setattr(probing, "_READ_S", 0.05)
    with pytest.raises(BadInputError, match="crashes or hangs"):
        probe.check(path)
    assert not reader.is_running()
    monkeypatch.undo()
    probe.check(path)


@pytest.mark.slow
def test_a_thousand_damaged_files(tmp_path, a_trial):
    path = _blank_file(tmp_path, a_trial)
    contents = path.read_bytes()
    _read_all(path, contents[:-25], 1000, seed=6)
    write_trial(path, a_trial(100, status="aborted", command_v=None))
    _read_all(path, path.read_bytes()[:-25], 1000, seed=7)
