"""Progress counts the bench's time, rests included, and reads as a person says it."""

from __future__ import annotations

import json

import pytest

from rig.engine.progress import Countdown, Snapshot, clock_words
from rig.engine.states import State
from rig.protocols.steps import PlannedTrial, Rest, Stay


def trial(rest_s: float, stay_s: float) -> PlannedTrial:
    return PlannedTrial("t", "force_calibration", (Rest(rest_s),), (Stay("dwell", stay_s),))


def test_time_left_counts_rests() -> None:
    countdown = Countdown([trial(120, 9), trial(150, 9)])
    assert countdown.left_s == pytest.approx(120 + 9 + 150 + 9 + 2)
    countdown.use(120)
    assert countdown.left_s == pytest.approx(9 + 150 + 9 + 2)
    countdown.next_trial()
    assert countdown.left_s == pytest.approx(150 + 9 + 1)
    assert countdown.done_s == pytest.approx(120)


def test_a_trial_longer_than_expected_leaves_the_rest_as_it_was() -> None:
    countdown = Countdown([trial(0, 1), trial(0, 5)])
    countdown.use(100)
    assert countdown.left_s == pytest.approx(6)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(7.4, "7 s"), (250, "4 min 10 s"), (3600 * 3 + 52 * 60, "3 h 52 min"), (0, "0 s"), (59.6, "1 min 00 s")],
)
def test_clock_words(seconds: float, words: str) -> None:
    assert clock_words(seconds) == words


def test_a_snapshot_survives_the_journey() -> None:
    snapshot = Snapshot("study", State.RESTING, "003", 3, 100, 12.0, 40.0, "resting")
    message = json.dumps(json.loads(snapshot.as_message()) | {"of_a_newer_version": 1})
    assert Snapshot.from_message(message.encode()) == snapshot
