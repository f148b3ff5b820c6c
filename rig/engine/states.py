"""What a run can be doing, and what may follow: the engine's table of states."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum


class State(StrEnum):
    """What a run is doing at this moment."""

    IDLE = "idle"
    PREPARING = "preparing"
    RESTING = "resting"
    PAUSED = "paused"
    POSITIONING = "positioning"
    APPROACHING = "approaching"
    DWELLING = "dwelling"
    RAMPING = "ramping"
    HOLDING = "holding"
    RETRACTING = "retracting"
    CLEARING = "clearing"
    SWEEPING = "sweeping"
    LEAVING = "leaving"
    SAVED = "saved"
    FINISHED = "finished"
    STOPPED = "stopped"
    FAILED = "failed"


_S = State

TRANSITIONS: Mapping[State, frozenset[State]] = {
    _S.IDLE: frozenset({_S.PREPARING, _S.FINISHED, _S.LEAVING}),
    _S.PREPARING: frozenset({_S.PREPARING, _S.RESTING, _S.PAUSED, _S.POSITIONING, _S.FINISHED, _S.LEAVING}),
    _S.RESTING: frozenset({_S.PREPARING, _S.PAUSED, _S.POSITIONING, _S.LEAVING}),
    _S.PAUSED: frozenset({_S.PREPARING, _S.POSITIONING, _S.FINISHED, _S.LEAVING}),
    _S.POSITIONING: frozenset({_S.APPROACHING, _S.SWEEPING, _S.LEAVING}),
    _S.APPROACHING: frozenset({_S.DWELLING, _S.RETRACTING, _S.LEAVING}),
    _S.DWELLING: frozenset({_S.RAMPING, _S.LEAVING}),
    _S.RAMPING: frozenset({_S.HOLDING, _S.LEAVING}),
    _S.HOLDING: frozenset({_S.RETRACTING, _S.LEAVING}),
    _S.RETRACTING: frozenset({_S.CLEARING, _S.LEAVING}),
    _S.CLEARING: frozenset({_S.LEAVING}),
    _S.SWEEPING: frozenset({_S.LEAVING}),
    _S.LEAVING: frozenset({_S.SAVED, _S.STOPPED, _S.FAILED}),
    _S.SAVED: frozenset({_S.PREPARING, _S.PAUSED, _S.FINISHED, _S.LEAVING}),
    _S.FINISHED: frozenset(),
    _S.STOPPED: frozenset(),
    _S.FAILED: frozenset(),
}
"""State to the states that may follow. From anywhere before the end, the way out leads through LEAVING,
where the one finaliser takes the arm clear of the skin."""

ENDED = frozenset(state for state, following in TRANSITIONS.items() if not following)
"""States with nothing after them."""


class StateMachine:
    """Holds the state of a run and refuses a step that the table does not allow."""

    def __init__(self) -> None:
        self.state = State.IDLE

    def to(self, state: State) -> None:
        """Go to `state`; RuntimeError (a fault of the program) where the table forbids it."""
        if state not in TRANSITIONS[self.state]:
            raise RuntimeError(f"the engine can't go from {self.state} to {state}")
        self.state = state
