"""The table of a study takes what runs, folders and fits say, each once."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.engine.progress import Snapshot
from rig.engine.states import State
from rig.engine.tasks import Ended
from rig.gui.jobs.headers import BEING_WRITTEN, Header
from rig.gui.study_table import StudyTable, newly
from rig.protocols.planning import plan_of
from rig.settings.reading import parse_protocol

STUDY = 'kind = "study"\n[study]\nfingers = ["index"]\ndepths_mm = [0.2, 0.4]\nrepeats = 1\n'
FIRST, SECOND = "001_index_0.20mm_r1", "002_index_0.40mm_r1"


@pytest.fixture
def table(qapp: Any) -> StudyTable:
    made = StudyTable()
    made.load(plan_of(parse_protocol(STUDY, "study.toml"), 0.5).trials)
    return made


def states(table: StudyTable) -> list[str]:
    return [row.state for row in table.rows]


def test_a_model_as_qt_wants_it(table: StudyTable, qtmodeltester: Any) -> None:
    qtmodeltester.check(table)


def test_what_is_under_way_and_what_has_ended(table: StudyTable) -> None:
    table.take_snapshot(Snapshot("study", State.HOLDING, FIRST, out="/s"))
    assert states(table) == ["holding", "to do"]
    table.take_snapshot(Snapshot("study", State.STOPPED, FIRST, out="/s"))
    assert states(table) == ["to do", "to do"]
    ended = (Ended(FIRST, f"{FIRST}.h5", "complete"),)
    table.take_snapshot(Snapshot("study", State.RESTING, SECOND, out="/s", ended=ended))
    assert states(table) == ["complete", "resting"]
    # a repeat that fails does not take the good one's place
    worse = (*ended, Ended(FIRST, f"{FIRST}_again2.h5", "cut short"))
    table.take_snapshot(Snapshot("study", State.IDLE, out="/s", ended=worse))
    assert states(table)[0] == "complete"
    assert Path(table.rows[0].file) == Path(f"/s/{FIRST}.h5")


def test_what_it_ended_as_stands_until_it_is_recorded_again(table: StudyTable) -> None:
    cut = (Ended(FIRST, f"{FIRST}.h5", "cut short"),)
    for state in (State.LEAVING, State.SAVED, State.PAUSED, State.PREPARING):
        table.take_snapshot(Snapshot("study", state, FIRST, out="/s", ended=cut))
        assert states(table)[0] == "aborted"
    again = f"{FIRST}_again2.h5"
    table.take_snapshot(Snapshot("study", State.HOLDING, FIRST, out="/s", ended=cut, file=again))
    assert states(table)[0] == "holding"
    ended = (*cut, Ended(FIRST, again, "complete"))
    table.take_snapshot(Snapshot("study", State.LEAVING, FIRST, out="/s", ended=ended))
    table.take_snapshot(Snapshot("study", State.PREPARING, SECOND, out="/s", ended=ended))
    assert states(table) == ["complete", "preparing"]


def test_what_was_said_before_does_not_undo_what_has_been_done_since(table: StudyTable) -> None:
    ended = (Ended(FIRST, f"{FIRST}.h5", "complete"),)
    idle = Snapshot("study", State.IDLE, out="/s", ended=ended)
    table.take_snapshot(idle)
    discarded = Header(f"/s/{FIRST}.h5", 1, 1, status="complete", discarded="the finger moved")
    table.take_headers([discarded])
    table.take_snapshot(idle)
    assert states(table)[0] == "discarded"


def test_the_good_attempt_counts_else_the_newest(table: StudyTable) -> None:
    table.take_headers(
        [
            Header(f"/s/{FIRST}.h5", 1, 1, status="complete"),
            Header(f"/s/{FIRST}_again2.h5", 1, 1, status="aborted"),
            Header(f"/s/{SECOND}.h5", 1, 1, status="aborted"),
            Header(f"/s/{SECOND}_again2.h5", 1, 1, status="recovered"),
            Header("/s/something_else.h5", 1, 1, status="complete"),
        ]
    )
    assert states(table) == ["complete", "recovered"]
    assert table.n_done() == 1


@given(st.integers(0, 20), st.integers(0, 20), st.integers(0, 20))
def test_only_what_is_new_is_new(dropped: int, kept: int, added: int) -> None:
    ends = tuple(Ended(str(i), f"{i}.h5", "complete") for i in range(dropped + kept + added))
    before, now = ends[: dropped + kept], ends[dropped:]
    assert newly(before, now) == ends[dropped + kept :]


def test_what_a_fit_said_stands_when_the_folder_is_read_again(table: StudyTable) -> None:
    file = f"/s/{FIRST}.h5"
    complete = Header(file, 1, 1, status="complete")
    table.take_headers([complete])
    table._change(FIRST, quality="t1 is longer than the hold", raised=True)
    table.take_headers([complete])
    assert table.rows[0].quality == "t1 is longer than the hold"
    table.take_headers([replace(complete, discarded="the finger moved")])
    assert (table.rows[0].state, table.rows[0].quality) == ("discarded", "the finger moved")


@pytest.mark.parametrize(
    ("header", "state", "quality"),
    [
        (Header(f"/s/{FIRST}.h5", 1, 1, status="running"), "cut off", ""),
        (Header(f"/s/{FIRST}.h5", 1, 1, problem="is empty"), "unreadable", "is empty"),
        (Header(f"/s/{FIRST}.h5", 1, 1, problem=BEING_WRITTEN), BEING_WRITTEN, ""),
    ],
)
def test_a_file_that_is_no_good_says_so(table: StudyTable, header: Header, state: str, quality: str) -> None:
    table.take_headers([header])
    assert (table.rows[0].state, table.rows[0].quality) == (state, quality)


def test_a_trial_that_ended_before_it_had_a_file_is_still_to_do(table: StudyTable) -> None:
    table.take_snapshot(Snapshot("study", State.PREPARING, FIRST, out="/s"))
    ended = (Ended(FIRST, "", "cut short", "stopped by the operator"),)
    table.take_snapshot(Snapshot("study", State.IDLE, FIRST, out="/s", ended=ended))
    assert (table.rows[0].state, table.rows[0].file) == ("to do", "")
    good = (*ended, Ended(FIRST, f"{FIRST}.h5", "complete"))
    table.take_snapshot(Snapshot("study", State.IDLE, out="/s", ended=good))
    table.take_snapshot(Snapshot("study", State.IDLE, out="/s", ended=(*good, Ended(FIRST, "", "cut short"))))
    assert states(table)[0] == "complete", "a repeat that never began takes nothing from a good one"


def test_what_was_under_way_in_a_program_that_died_is_so_no_longer(table: StudyTable) -> None:
    table.take_snapshot(Snapshot("study", State.HOLDING, FIRST, out="/s"))
    table.run_died()
    assert states(table) == ["to do", "to do"]
