"""The table of states: the way out is open from everywhere, and leads past the finaliser."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.engine.states import ENDED, TRANSITIONS, State, StateMachine

TRIAL = [
    State.PREPARING,
    State.RESTING,
    State.POSITIONING,
    State.APPROACHING,
    State.DWELLING,
    State.RAMPING,
    State.HOLDING,
    State.RETRACTING,
    State.CLEARING,
    State.LEAVING,
    State.SAVED,
    State.FINISHED,
]


def test_every_state_is_in_the_table() -> None:
    assert set(TRANSITIONS) == set(State)
    assert {State.FINISHED, State.STOPPED, State.FAILED} == ENDED


def test_a_trial_walks_through() -> None:
    machine = StateMachine()
    for state in TRIAL:
        machine.to(state)
    assert machine.state is State.FINISHED


@given(steps=st.lists(st.sampled_from(list(State)), max_size=12))
def test_a_run_that_has_moved_ends_only_by_way_of_leaving(steps: list[State]) -> None:
    machine = StateMachine()
    seen = [machine.state]
    for state in steps:
        try:
            machine.to(state)
        except RuntimeError:
            assert state not in TRANSITIONS[machine.state]
        else:
            seen.append(state)
    for before, after in pairwise(seen):
        if after in {State.STOPPED, State.FAILED, State.SAVED}:
            assert before is State.LEAVING


@pytest.mark.parametrize("state", [s for s in State if s not in ENDED and s is not State.LEAVING])
def test_the_finaliser_is_reached_from_everywhere(state: State) -> None:
    assert State.LEAVING in TRANSITIONS[state]


def test_nothing_follows_the_end() -> None:
    machine = StateMachine()
    machine.to(State.FINISHED)
    with pytest.raises(RuntimeError, match="finished"):
        machine.to(State.PREPARING)
