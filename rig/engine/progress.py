"""How far a run is: what it does now, what is done, how much time is left, rests included."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal

from pydantic import TypeAdapter

from rig.engine.prompts import Prompt
from rig.engine.requests import Verdict
from rig.engine.states import State
from rig.engine.tasks import Ended
from rig.protocols.steps import PlannedTrial


@dataclass(frozen=True, slots=True)
class CalibrationInUse:
    """Where the constants of position or force come from: `calibrated` is empty where they are nominal."""

    kind: Literal["position", "force"]
    calibrated: str = ""
    valid_until: str = ""


@dataclass(frozen=True, slots=True)
class BenchFacts:
    """What does not change while a bench is open: limits, calibrations, whether it is a simulation, guards' pids."""

    rig: str
    simulated: bool
    travel_min_mm: float
    travel_max_mm: float
    safe_position_mm: float
    force_max_mn: float
    sample_rate_hz: float
    calibrations: tuple[CalibrationInUse, ...] = ()
    guards: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class MeasuredConstant:
    """One constant that a calibration found, with what is in use now."""

    name: str
    value: float
    half_width_95: float
    in_use: float


@dataclass(frozen=True, slots=True)
class CalibrationShown:
    """A calibration as it goes, and its result once there is one.

    `points` are (x, V): stage in mm, or weight in mN, and the signal there, one a trial.
    """

    kind: Literal["position", "force"]
    x_name: str
    points: tuple[tuple[float, float], ...] = ()
    constants: tuple[MeasuredConstant, ...] = ()
    r2: float | None = None
    decision: Literal["", "waiting", "kept", "left"] = ""
    file: str = ""


@dataclass(frozen=True, slots=True)
class Doubt:
    """Why a run that was asked for has not begun: it does where the request comes again with `accept`."""

    request: str
    words: str


@dataclass(frozen=True, slots=True)
class Snapshot:
    """One moment of a run, as observers and other processes see it. Times are those of the bench, s.

    `number` counts the snapshots of a bench; `file` is the one being written; `surface_mm` and
    `overshoot_um` are what the last approach found; `ended` holds the last trials and what became of them;
    `error` is what ended the last run; `trouble` is why the arm at rest can't be read; `doubt` is what is to
    be accepted before one begins.
    """

    title: str
    state: State
    trial: str = ""
    trial_number: int = 0
    n_trials: int = 0
    done_s: float = 0.0
    left_s: float = 0.0
    message: str = ""
    out: str = ""
    number: int = 0
    file: str = ""
    surface_mm: float | None = None
    overshoot_um: float | None = None
    threshold_mn: float | None = None
    n_samples: int = 0
    n_lost: int = 0
    rest_left_s: float = 0.0
    pausing: bool = False
    prompt: Prompt | None = None
    error: str = ""
    trouble: str = ""
    doubt: Doubt | None = None
    ended: tuple[Ended, ...] = ()
    calibration: CalibrationShown | None = None
    bench: BenchFacts | None = None
    answered: tuple[Verdict, ...] = ()

    def as_message(self) -> bytes:
        """Return the snapshot as a message."""
        return _snapshots().dump_json(self)

    @staticmethod
    def from_message(message: bytes) -> Snapshot:
        """Return the snapshot of a message; ValueError where it is none."""
        return _snapshots().validate_json(message)


@cache
def _snapshots() -> TypeAdapter[Snapshot]:
    return TypeAdapter(Snapshot)


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

    def insert(self, trial: PlannedTrial) -> None:
        """One more trial comes after this one."""
        self._ahead_s.insert(1, trial.expected_s)


def clock_words(seconds: float) -> str:
    """Return a length of time as a person reads it: 3 h 52 min, 4 min 10 s, 7 s."""
    whole = round(seconds)
    hours, minutes, rest = whole // 3600, whole // 60 % 60, whole % 60
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
