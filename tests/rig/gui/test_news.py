"""What is said of two snapshots that follow each other."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rig.engine.progress import Doubt, Snapshot
from rig.engine.prompts import Prompt
from rig.engine.states import State
from rig.engine.tasks import Ended
from rig.gui.bench_state import BenchState
from rig.gui.news import Line, news

IDLE = Snapshot(title="", state=State.IDLE)
RUN = Snapshot(title="study", state=State.RESTING)
GONE = replace(IDLE, trouble="card Dev1: does not answer")


@pytest.mark.parametrize(
    ("before", "now", "said"),
    [
        (IDLE, IDLE, []),
        (IDLE, GONE, [("the arm can't be read: card Dev1: does not answer", "bad")]),
        (GONE, GONE, []),
        (GONE, IDLE, [("the arm is read again", "good")]),
        (IDLE, replace(IDLE, message="nothing is left to run"), [("nothing is left to run", "note")]),
        (RUN, replace(RUN, state=State.IDLE, message="stopped by the operator"), []),
        (IDLE, replace(IDLE, error="no such file"), [("no such file", "bad")]),
        (IDLE, replace(IDLE, doubt=Doubt("1", "go on?")), [("not begun yet: go on?", "note")]),
        (RUN, replace(RUN, n_lost=3), [("3 samples lost", "bad")]),
        (
            RUN,
            replace(RUN, prompt=Prompt("1", "clear_air", "Clear the air")),
            [("the bench asks: Clear the air", "note")],
        ),
        (
            replace(RUN, ended=(Ended("a", "a.h5", "complete"),)),
            replace(
                RUN,
                ended=(
                    Ended("a", "a.h5", "complete"),
                    Ended("b", "b.h5", "failed", "the force limit"),
                    Ended("c", "", "cut short", "stopped"),
                ),
            ),
            [("b.h5: failed, the force limit", "note"), ("c: cut short, stopped", "")],
        ),
    ],
)
def test_what_is_said(before: Snapshot, now: Snapshot, said: list[Line]) -> None:
    assert list(news(before, now)) == said


def test_a_bench_whose_arm_can_not_be_read_is_not_ready() -> None:
    state = BenchState(link="open", snapshot=GONE)
    assert not state.ready
    assert state.words == "the arm can't be read"
    assert BenchState(link="open", snapshot=IDLE).ready
    assert BenchState(link="died").words == "the rig did not open"
