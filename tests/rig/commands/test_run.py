"""Runs as real processes: Ctrl-C, watching from outside, and what is left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from analysis.recordings import read_trial
from rig.commands.watch import screen, trace, watch
from rig.engine.following import Follower, follow_newest
from rig.engine.states import State
from rig.errors import RigError

PROTOCOL = """
kind = "ramp_hold_retract"
[surface]
start_mm = 2.9
approach_speed_mm_s = 2.0
[indentation]
depth_mm = 0.3
dwell_s = 0.3
hold_s = 60.0
"""


@pytest.fixture
def run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, real_time_rig: str
) -> Iterator[subprocess.Popen[str]]:
    """A run that holds for a minute, in a process of its own."""
    monkeypatch.setenv("INDENTER_RUNTIME_DIR", str(tmp_path / "runs"))
    (tmp_path / "one.toml").write_text(PROTOCOL)
    (tmp_path / "rig.toml").write_text(real_time_rig)
    process = subprocess.Popen(
        [sys.executable, "-m", "rig.cli", "run", "one.toml", "--rig", "rig.toml", "--out", "out"],
        cwd=tmp_path,
        env=os.environ.copy(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    yield process
    if process.poll() is None:
        process.kill()
    process.communicate()


@contextmanager
def following(run: subprocess.Popen[str], state: State, patience_s: float = 60.0) -> Iterator[Follower]:
    """Follow the run once it has come to a state."""
    deadline = time.monotonic() + patience_s
    follower = None
    while follower is None:
        assert run.poll() is None, run.communicate()
        assert time.monotonic() < deadline, "the run was never announced"
        follower = follow_newest()
    with follower:
        while True:
            snapshot = follower.snapshot()
            assert snapshot is not None, run.communicate()
            if snapshot.state is state:
                break
            assert time.monotonic() < deadline, f"the run never came to {state}"
        yield follower


def test_watched_then_stopped_with_ctrl_c(run: subprocess.Popen[str], tmp_path: Path) -> None:
    with following(run, State.HOLDING) as follower:
        snapshot = follower.snapshot()
        assert snapshot is not None
        assert 0 < snapshot.left_s < 120
        _, volts = follower.ring.latest(8000)
        force_mn = volts[1] / 0.015
        assert force_mn.max() > 15
        shown = StringIO()
        Console(width=100, file=shown).print(screen(snapshot, follower))
        assert "holding" in shown.getvalue()
        assert "mN" in shown.getvalue()
    run.send_signal(signal.SIGINT)
    time.sleep(0.05)
    run.send_signal(signal.SIGINT)
    _, said = run.communicate(timeout=30)
    assert run.returncode == 130, said
    assert "Traceback" not in said
    assert said.splitlines()[-1] == "indenter: stopped by the operator"
    trial = read_trial(tmp_path / "out" / "index_0.30mm.h5")
    assert trial.status == "aborted"
    assert trial.n_samples > 4000
    assert list((tmp_path / "runs").glob("*.json")) == [], "the announcement is taken back"


def test_stopped_by_a_request_from_outside(run: subprocess.Popen[str]) -> None:
    with following(run, State.HOLDING) as follower:
        follower.request("stop")
        run.communicate(timeout=30)
    assert run.returncode == 130


def test_nothing_to_watch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("INDENTER_RUNTIME_DIR", str(tmp_path))
    with pytest.raises(RigError, match="no run is in progress"):
        watch()


def test_trace_keeps_peaks() -> None:
    import numpy as np

    values = np.zeros(6000)
    values[3005] = 1.0
    line = trace(values, 60)
    assert len(line) == 60
    assert line[30] == "█"
    assert set(line[:30] + line[31:]) == {"▁"}
    assert trace(np.ones(100), 10) == "▁" * 10
