"""A bench in a process of its own: idle it shows samples, it runs what it is asked for, it dies with its window."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import psutil
import pytest

from analysis.recordings import read_trial
from rig.calibration.kept import load_calibration, save_calibration
from rig.calibration.lines import Constant, line_through
from rig.calibration.mixing import keep_rig
from rig.engine.announcing import announcements
from rig.engine.progress import Snapshot
from rig.engine.requests import Verdict
from rig.engine.states import State
from rig.gui.runner_process import RunnerProcess, wait_for
from rig.settings.reading import load_rig

ONE = """
kind = "ramp_hold_retract"
[surface]
start_mm = 2.9
approach_speed_mm_s = 2.0
[indentation]
depth_mm = 0.3
dwell_s = 0.2
hold_s = 30.0
"""
SHORT = ONE.replace("30.0", "0.3")
TWO = """
kind = "study"
[study]
fingers = ["index"]
depths_mm = [0.3]
repeats = 2
rest_s = 60.0
[surface]
start_mm = 2.9
approach_speed_mm_s = 2.0
[indentation]
dwell_s = 0.2
hold_s = 0.3
"""
MEASURED = {
    "volts_per_mm": 2.043,
    "command_volts_per_mm": 2.042,
    "position_zero_v": -10.0,
    "command_zero_v": -10.0,
}
"""What a later position calibration found: one gain differs from the nominal 2.042 V/mm by half a part in a
thousand."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, real_time_rig: str) -> Path:
    monkeypatch.setenv("INDENTER_RUNTIME_DIR", str(tmp_path / "runs"))
    (tmp_path / "rig.toml").write_text(real_time_rig)
    (tmp_path / "one.toml").write_text(ONE)
    (tmp_path / "short.toml").write_text(SHORT)
    return tmp_path


@contextmanager
def served(folder: Path) -> Iterator[RunnerProcess]:
    started = RunnerProcess(folder / "rig.toml", folder / "bench.log")
    wait_for(started, lambda snapshot: snapshot.state is State.IDLE and snapshot.bench is not None)
    yield started
    assert started.close(60.0) == 0, started.last_words()
    assert announcements() == []


@pytest.fixture
def process(folder: Path) -> Iterator[RunnerProcess]:
    with served(folder) as started:
        yield started


def verdict(process: RunnerProcess, request_id: str) -> Verdict:
    def said(snapshot: Snapshot) -> bool:
        return any(answer.id == request_id for answer in snapshot.answered)

    answered = wait_for(process, said).answered
    return next(answer for answer in answered if answer.id == request_id)


def idle_again(snapshot: Snapshot) -> bool:
    return snapshot.state is State.IDLE


def test_a_life(process: RunnerProcess, folder: Path) -> None:
    facts = process.snapshot.bench if process.snapshot is not None else None
    assert facts is not None
    assert facts.simulated
    assert facts.force_max_mn == 400.0
    assert process.follower is not None
    ring = process.follower.ring
    before, now = ring.written, time.monotonic()
    while ring.written - before < 8000:
        assert time.monotonic() - now < 30
        time.sleep(0.01)
    assert time.monotonic() - now > 0.5, "the resting arm is shown in real time"
    assert ring.marks()[-1].name == "idle"

    asked = process.ask("run", protocol=str(folder / "no.toml"), out=str(folder / "out"))
    assert verdict(process, asked).accepted
    failed = wait_for(process, lambda s: s.state is State.IDLE and bool(s.error))
    assert "no such file" in failed.error

    # by hand: the prompt is answered by a message, and only once
    asked = process.ask("run", protocol=str(folder / "short.toml"), out=str(folder / "out"))
    prompt = wait_for(process, lambda s: s.prompt is not None).prompt
    assert prompt is not None
    assert "Place the index finger" in prompt.words
    asked = process.ask("run", protocol=str(folder / "short.toml"), out=str(folder / "out"))
    assert not verdict(process, asked).accepted
    while_asked = ring.written
    time.sleep(0.5)
    assert ring.written > while_asked, "the live view goes on while a hand is awaited"
    assert verdict(process, process.ask("answer", prompt=prompt.id, answer="done")).accepted
    assert not verdict(process, process.ask("answer", prompt=prompt.id, answer="done")).accepted
    done = wait_for(process, idle_again)
    assert [(ended.file, ended.outcome) for ended in done.ended] == [("index_0.30mm.h5", "complete")]
    assert read_trial(folder / "out" / "index_0.30mm.h5").status == "complete"
    names = [mark.name for mark in ring.marks()]
    assert names[names.index("trial") :][:8] == [
        "trial",
        "approach",
        "dwell",
        "ramp",
        "hold",
        "retract",
        "clear",
        "end",
    ]

    # once more: all is done, and that is said
    process.ask("run", protocol=str(folder / "short.toml"), out=str(folder / "out"), hands="bench")
    assert "nothing is left" in wait_for(process, lambda s: bool(s.message) and idle_again(s)).message

    process.ask("run", protocol=str(folder / "one.toml"), out=str(folder / "held"), hands="bench")
    wait_for(process, lambda s: s.state is State.HOLDING)
    assert verdict(process, process.ask("stop")).accepted
    stopped = wait_for(process, idle_again)
    assert stopped.ended[-1].outcome == "cut short"
    assert read_trial(folder / "held" / "index_0.30mm.h5").status == "aborted"


def test_the_window_dies_and_the_trial_is_kept(process: RunnerProcess, folder: Path) -> None:
    process.ask("run", protocol=str(folder / "one.toml"), out=str(folder / "held"), hands="bench")
    wait_for(process, lambda s: s.state is State.HOLDING)
    assert process.close(60.0) == 0, process.last_words()
    trial = read_trial(folder / "held" / "index_0.30mm.h5")
    assert trial.status == "aborted"
    assert [phase.name for phase in trial.phases] == ["approach", "dwell", "ramp", "hold"]


def test_a_force_calibration_waits_to_be_accepted(process: RunnerProcess, folder: Path) -> None:
    assert not verdict(process, process.ask("accept", keep=True)).accepted
    process.ask("calibrate", which="force", hands="bench")
    points = wait_for(process, lambda s: s.calibration is not None and len(s.calibration.points) >= 2)
    assert points.calibration is not None
    result = wait_for(process, lambda s: idle_again(s) and s.calibration is not None, 200.0).calibration
    assert result is not None
    assert (result.decision, len(result.points)) == ("waiting", 7)
    assert result.r2 is not None
    assert result.r2 > 0.999
    assert {constant.name for constant in result.constants} == {"volts_per_mn", "force_zero_v"}
    assert list((folder / "calibrations").glob("*.json")) == [], "nothing is kept before it is accepted"
    assert verdict(process, process.ask("accept", keep=True)).accepted
    kept = wait_for(process, lambda s: s.calibration is not None and s.calibration.decision == "kept")
    assert kept.calibration is not None
    assert load_calibration(Path(kept.calibration.file)).kind == "force"


def test_a_study_of_another_calibration_begins_only_where_that_is_accepted(folder: Path) -> None:
    protocol, out = folder / "two.toml", folder / "out"
    protocol.write_text(TWO)
    order = {"protocol": str(protocol), "out": str(out), "hands": "bench"}
    rig = load_rig(folder / "rig.toml")
    out.mkdir()
    keep_rig(rig, rig.calibration.nominal(), out)  # begun with the nominal constants; since then measured
    begun_with = (out / "rig.json").read_bytes()
    save_measured(folder / "calibrations")
    with served(folder) as process:
        seen: list[State] = []

        def doubted(request: str) -> Snapshot:
            def said(snapshot: Snapshot) -> bool:
                seen.append(snapshot.state)
                return snapshot.doubt is not None and snapshot.doubt.request == request

            return wait_for(process, said)

        raised = doubted(process.ask("run", **order))
        assert raised.doubt is not None
        assert "recorded with another calibration (volts_per_mm changed)" in raised.doubt.words
        assert raised.error == ""
        # refused: whoever asked says no more, and nothing has happened
        assert (out / "rig.json").read_bytes() == begun_with
        assert [path.name for path in out.iterdir()] == ["rig.json"]
        doubted(process.ask("run", **order))  # asked again without a word on it: doubted again
        process.ask("run", protocol=str(folder / "no.toml"), out=str(out), accept=True)
        other = wait_for(process, lambda s: bool(s.error))
        assert other.doubt is None, "a doubt stands until the next order"
        assert set(seen) == {State.IDLE}, "the arm stays where it is"
        assert process.follower is not None
        assert {mark.name for mark in process.follower.ring.marks()} <= {"idle"}, "no trial"

        process.ask("run", **order, accept=True)
        wait_for(process, lambda s: len(s.ended) == 1 and s.state is State.RESTING)
        process.ask("stop")
        wait_for(process, idle_again)
        assert read_trial(out / "001_index_0.30mm_r1.h5").calibration.volts_per_mm == 2.043
        assert json.loads((out / "rig.json").read_text())["constants"]["volts_per_mm"] == 2.043
        # accepted once, it is this study's calibration, and is not asked about again
        process.ask("run", **order)
        begun = wait_for(process, lambda s: s.state is State.RESTING)
        assert begun.doubt is None
        process.ask("stop")
        wait_for(process, idle_again)


def save_measured(calibrations: Path) -> None:
    """A position calibration of the rig that is connected, made just now."""
    x = np.linspace(0.0, 0.8, 6)
    line = line_through(x, 2.043 * x)
    constants = {name: Constant(value, 1e-4, 4) for name, value in MEASURED.items()}
    save_calibration(calibrations, "position", constants, line, rig="", valid_days=30.0, about={})


def test_that_the_card_is_gone_is_told_while_nothing_runs(folder: Path) -> None:
    process = RunnerProcess(folder / "rig.toml", folder / "bench.log")
    wait_for(process, lambda s: s.state is State.IDLE and s.bench is not None)
    cards = [
        child
        for child in psutil.Process(process.pid).children(recursive=True)
        if "sim_hardware" in child.cmdline()
    ]
    assert len(cards) == 1
    assert process.snapshot is not None
    assert process.snapshot.trouble == ""
    cards[0].kill()
    told = ""
    until = time.monotonic() + 60
    while not told:
        # as the loss is met: the bench says so and tries again, or ends because it can't move the arm either
        now = process.poll()
        told = now.trouble if now is not None else ""
        told = told or (process.last_words() if process.exit_code is not None else "")
        assert time.monotonic() < until, "nothing is said of it"
        time.sleep(0.005)
    assert "Dev1" in told
    process.close(60.0)


def test_a_rig_that_does_not_open_says_why(folder: Path) -> None:
    (folder / "bad.toml").write_text('[card]\naddress = "127.0.0.1:9"\n')
    started = RunnerProcess(folder / "bad.toml", folder / "bench.log")
    with pytest.raises(TimeoutError, match=r"127\.0\.0\.1:9"):
        wait_for(started, lambda _: False)
    assert started.exit_code == 1
    started.close()
    assert os.environ["INDENTER_RUNTIME_DIR"]
