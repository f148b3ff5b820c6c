"""A run is followed from another process, however late it comes, and hears a request."""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.recordings.trial import Calibration
from rig.engine.announcing import announcements
from rig.engine.feed import Feed
from rig.engine.following import Follower, follow_newest
from rig.engine.progress import BenchFacts, Snapshot
from rig.engine.requests import Request, Verdict, make_request
from rig.engine.ring import RingReader
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
            shown = follower.snapshot()
            assert shown is not None
            assert replace(shown, number=0) == snapshot
            assert follower.ring.latest(10)[0] == 390
            feed.show(Snapshot("study", State.FINISHED))
            ended = follower.snapshot()
            assert ended is not None
            assert ended.state is State.FINISHED
    assert announcements() == []


def test_who_follows_before_anything_was_shown_gets_the_first_snapshot(tmp_path: Path) -> None:
    facts = BenchFacts("b", True, 0.0, 10.0, 0.5, 400.0, 8000.0)
    first = Snapshot(title="", state=State.IDLE, bench=facts)
    with Feed("study", tmp_path, 8000.0, CALIBRATION, first=first):
        follower = follow_newest()
        assert follower is not None
        with follower:
            shown = follower.snapshot()
            assert shown is not None
            assert shown.bench == facts


def accepting(heard: list[Request], came: threading.Event) -> Callable[[Request], Verdict]:
    def hear(request: Request) -> Verdict:
        heard.append(request)
        came.set()
        return Verdict(request.id, accepted=True)

    return hear


def verdict_on(follower: Follower, request_id: str) -> Verdict:
    """Wait for the snapshot that says what became of a request."""
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        snapshot = follower.snapshot()
        for verdict in snapshot.answered if snapshot is not None else ():
            if verdict.id == request_id:
                return verdict
    raise AssertionError("no verdict came")


def test_a_request_is_answered_in_a_snapshot_and_done_once(tmp_path: Path) -> None:
    heard: list[Request] = []
    came = threading.Event()
    with Feed("study", tmp_path, 8000.0, CALIBRATION, accepting(heard, came)) as feed:
        feed.show(Snapshot("study", State.IDLE))
        with Follower(announcements()[0]) as follower:
            stop = make_request("stop")
            follower.send(stop)
            follower.send(stop)
            assert verdict_on(follower, stop.id).accepted
            discard = follower.request("discard", file="001.h5", reason="the finger moved")
            assert verdict_on(follower, discard).accepted
    assert [request.do for request in heard] == ["stop", "discard"]


STRANGE = [
    b"",
    b"\xff not json",
    b"[1, 2]",
    b"[" * 100_000,
    b'{"a":' * 3000,
    b'{"do": "stop"}',
    b'{"token": "guessed", "request": "{}"}',
    b'{"token": 7, "request": []}',
    b'"' + b"x" * 500_000,
    b"\x00" * 64,
]


def test_no_message_stops_the_feed_or_holds_up_the_run(tmp_path: Path) -> None:
    heard: list[Request] = []
    came = threading.Event()
    with Feed("study", tmp_path, 8000.0, CALIBRATION, accepting(heard, came)) as feed:
        feed.show(Snapshot("study", State.IDLE))
        said = announcements()[0]
        with Follower(said) as follower:
            for message in STRANGE * 20:
                follower._requests.send(message)
                before = time.monotonic()
                feed.show(Snapshot("study", State.HOLDING))
                assert time.monotonic() - before < 1.0
        # a sender of too long a message is disconnected, and others are heard all the same
        with Follower(said) as follower:
            assert follower.snapshot() is not None
            wrong = {"token": said.token, "request": '{"id": "me", "do": "stop", "more": 1}'}
            follower._requests.send(json.dumps(wrong).encode())
            refused = verdict_on(follower, "me")
            assert (refused.accepted, "more" in refused.why) == (False, True)
            assert verdict_on(follower, follower.request("pause")).accepted
    assert [request.do for request in heard] == ["pause"], "none without the token, none malformed"


def test_a_listener_that_fails_is_no_end_of_the_feed(tmp_path: Path) -> None:
    def fail(_: Request) -> Verdict:
        raise RuntimeError("a fault")

    with Feed("study", tmp_path, 8000.0, CALIBRATION, fail) as feed:
        feed.show(Snapshot("study", State.IDLE))
        with Follower(announcements()[0]) as follower:
            assert "fault" in verdict_on(follower, follower.request("stop")).why
            assert "fault" in verdict_on(follower, follower.request("stop")).why


def test_a_dead_feed_holds_nothing_up(tmp_path: Path) -> None:
    with Feed("study", tmp_path, 8000.0, CALIBRATION) as feed:
        feed._inbox.send(b"")  # its thread ends, as if it had died
        feed._thread.join(5)
        before = time.monotonic()
        for _ in range(3000):
            feed.show(Snapshot("study", State.HOLDING))
        assert time.monotonic() - before < 2.0


def test_only_the_user_may_read_the_token(tmp_path: Path) -> None:
    with Feed("study", tmp_path, 8000.0, CALIBRATION):
        (path,) = tmp_path.glob("run-*.json")
        assert path.stat().st_mode & 0o077 == 0


def test_marks_say_where_trials_and_phases_began(tmp_path: Path) -> None:
    with Feed("study", tmp_path, 8000.0, CALIBRATION) as feed:
        feed.follow(chunk(0, 100))
        feed.mark("trial", 0, 0)
        feed.follow(chunk(0, 400))
        feed.mark("ramp", 250, 400)
        feed.mark("end", 400, 400)
        with RingReader(announcements()[0].ring) as ring:
            marks = ring.marks()
    assert [(mark.name, mark.index, mark.number) for mark in marks] == [
        ("trial", 100, 1),
        ("ramp", 350, 1),
        ("end", 500, 1),
    ]
    assert abs(marks[0].time_s - time.time()) < 60


def test_no_run_and_a_dead_run(tmp_path: Path) -> None:
    assert follow_newest() is None
    (tmp_path / f"run-{os.getpid()}.json").write_text("{ not json")
    assert follow_newest() is None
    (tmp_path / "run-1.json").write_text('{"version": 1, "pid": 1}')
    assert announcements() == [], "one of another version is not followed"
    (tmp_path / "run-1.json").write_text(
        '{"version": 2, "token": "x", "pid": 1, "title": "", "out": "", "ring": "indenter-gone", '
        '"snapshots": "tcp://127.0.0.1:9", "requests": "tcp://127.0.0.1:9"}'
    )
    assert follow_newest() is None
