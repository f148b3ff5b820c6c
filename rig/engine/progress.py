"""How far a run is: what it does now, what is done, how much time is left, rests included."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Self

from rig.engine.states import State
from rig.protocols.steps import PlannedTrial


@dataclass(frozen=True, slots=True)
class Snapshot:
    """One moment of a run, as observers and other processes see it. Times are those of the bench, s."""

    title: str
    state: State
    trial: str = ""
    trial_number: int = 0
    n_trials: int = 0
    done_s: float = 0.0
    left_s: float = 0.0
    message: str = ""
    out: str = ""

    def as_message(self) -> dict[str, Any]:
        """Return the snapshot as a message: plain texts and numbers."""
        return asdict(self) | {"state": str(self.state)}

    @classmethod
    def from_message(cls, message: dict[str, Any]) -> Self:
        """Return the snapshot of a message; keys of a newer version are passed over."""
        known = {name: message[name] for name in cls.__slots__ if name in message}
        return cls(**known | {"state": State(message["state"])})


class Countdown:
    """Keeps the time that is left: what the trials ahead should take, less what this one has used."""

    def __init__(self, trials: Sequence[PlannedTrial]) -> None:
        self._ahead_s = [trial.expected_s for trial in trials]
        self._done_s = 0.0
        self._in_trial_s = 0.0

    @property
    def done_s(self) -> float:
        """Bench time used so far, s."""
        return self._done_s + self._in_trial_s

    @property
    def left_s(self) -> float:
        """Bench time still expected, s."""
        if not self._ahead_s:
            return 0.0
        return sum(self._ahead_s[1:]) + max(0.0, self._ahead_s[0] - self._in_trial_s)

    def use(self, seconds: float) -> None:
        """Count bench time spent on this trial."""
        self._in_trial_s += seconds

    def next_trial(self) -> None:
        """This trial is over; what it left unused is not spent."""
        self._done_s += self._in_trial_s
        self._in_trial_s = 0.0
        del self._ahead_s[:1]


def clock_words(seconds: float) -> str:
    """Return a length of time as a person reads it: 3 h 52 min, 4 min 10 s, 7 s."""
    whole = round(seconds)
    hours, minutes, rest = whole // 3600, whole // 60 % 60, whole % 60
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
