"""A run is followed from another process, however late it comes, and hears a request."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.recordings.trial import Calibration
from rig.engine.announcing import announcements
from rig.engine.feed import Feed
from rig.engine.following import Follower, follow_newest
from rig.engine.progress import Snapshot
from rig.engine.states import State
from rig.hardware.lever import Chunk

CALIBRATION = Calibration(2.0, -10.0, 0.015, 0.0, 2.0, -10.0)


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("INDENTER_RUNTIME_DIR", str(tmp_path))
    return tmp_path


def chunk(start: int, n: int) -> Chunk:
    values = np.arange(start, start + n, dtype=float)
    return Chunk(start, values, values, values, CALIBRATION)


def test_a_latecomer_gets_the_last_snapshot_and_the_last_samples(tmp_path: Path) -> None:
    snapshot = Snapshot("study", State.HOLDING, "007", 7, 100, 60.0, 600.0)
    with Feed("study", tmp_path, 8000.0, CALIBRATION) as feed:
        feed.show(snapshot)
        feed.follow(chunk(0, 400))
        follower = follow_newest()
        assert follower is not None
        with follower:
            assert follower.snapshot() == snapshot
            assert follower.ring.latest(10)[0] == 390
            feed.show(Snapshot("study", State.FINISHED))
            ended = follower.snapshot()
            assert ended is not None
            assert ended.state is State.FINISHED
    assert announcements() == []


def test_requests_are_heard_and_nonsense_is_passed_over(tmp_path: Path) -> None:
    heard: list[dict[str, Any]] = []
    came = threading.Event()

    def hear(request: dict[str, Any]) -> None:
        heard.append(request)
        came.set()

    with Feed("study", tmp_path, 8000.0, CALIBRATION, hear) as feed:
        feed.show(Snapshot("study", State.IDLE))
        with Follower(announcements()[0]) as follower:
            follower._requests.send(b"\xff not json")
            follower._requests.send(b"[1, 2]")
            follower.request({"do": "stop"})
            assert came.wait(5)
    assert heard == [{"do": "stop"}]


def test_no_run_and_a_dead_run(tmp_path: Path) -> None:
    assert follow_newest() is None
    (tmp_path / f"run-{os.getpid()}.json").write_text("{ not json")
    assert follow_newest() is None
    (tmp_path / "run-1.json").write_text(
        '{"version": 1, "pid": 1, "title": "", "out": "", "ring": "indenter-gone", '
        '"snapshots": "tcp://127.0.0.1:9", "requests": "tcp://127.0.0.1:9"}'
    )
    assert follow_newest() is None
