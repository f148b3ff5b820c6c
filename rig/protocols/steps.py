"""What a run consists of: steps, trials and the plan, as frozen data. The engine is what acts on them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from analysis.recordings.trial import Kind, ProtocolSummary, Specimen


@dataclass(frozen=True, slots=True)
class Ask:
    """A hand is needed: `request` names for what (place_finger, place_block, ...)."""

    request: str
    details: Mapping[str, str | float | int | bool]
    expected_s: float = 0.0


@dataclass(frozen=True, slots=True)
class MoveStage:
    """Bring the Z stage to a height; without a stage the operator turns the micrometer."""

    position_um: float
    expected_s: float = 1.0


@dataclass(frozen=True, slots=True)
class WeighMass:
    """Hang a weight from the arm (0 g: none); a balance, where there is one, weighs it first."""

    mass_g: float
    expected_s: float = 2.0


@dataclass(frozen=True, slots=True)
class Rest:
    """Wait until so much time has passed since the previous indentation ended."""

    since_last_s: float


@dataclass(frozen=True, slots=True)
class Approach:
    """Move towards the skin until contact, at most to the travel limit.

    A force of `force_margin_mn` above the threshold, where given, reverses the arm at once. The threshold
    counts from the force of the free arm, in millinewtons or, where `threshold_v` is given, in volts of the
    force signal. Before recording, the arm goes to `start_mm`, or to `short_of_previous_mm`
    short of the contact found last in this run.
    """

    speed_mm_s: float
    threshold_mn: float
    samples_above: int
    samples_watched: int
    samples_per_read: int
    threshold_v: float | None = None
    force_margin_mn: float | None = None
    start_mm: float | None = None
    short_of_previous_mm: float | None = None


@dataclass(frozen=True, slots=True)
class Stay:
    """Record at rest for a while, as the phase of that name."""

    phase: str
    duration_s: float


@dataclass(frozen=True, slots=True)
class RampTo:
    """Press to a depth below the detected surface."""

    depth_mm: float
    speed_mm_s: float


@dataclass(frozen=True, slots=True)
class Retract:
    """Move away until contact is lost, at most `max_mm` above the surface."""

    speed_mm_s: float
    max_mm: float


@dataclass(frozen=True, slots=True)
class Sweep:
    """There and back at one speed with nothing below the arm; recorded from `from_mm` on."""

    from_mm: float
    to_mm: float
    speed_mm_s: float


Preparation = Ask | MoveStage | WeighMass | Rest
Motion = Approach | Stay | RampTo | Retract | Sweep


@dataclass(frozen=True, slots=True)
class PlannedTrial:
    """One file to be recorded: what is prepared, then what is done while samples are written."""

    name: str
    kind: Kind
    preparations: tuple[Preparation, ...]
    motions: tuple[Motion, ...]
    specimen: Specimen = field(default_factory=Specimen)
    summary: ProtocolSummary = field(default_factory=ProtocolSummary)

    @property
    def expected_s(self) -> float:
        """Time this trial is expected to take, s, its preparations and rest included."""
        return sum(expected_duration_s(step) for step in (*self.preparations, *self.motions)) + OVERHEAD_S

    def longest_s(self, travel_mm: float) -> float:
        """Time that is recorded at most, s, where an approach goes over the whole travel."""
        return sum(
            travel_mm / motion.speed_mm_s if isinstance(motion, Approach) else expected_duration_s(motion)
            for motion in self.motions
        )


OVERHEAD_S = 1.0
"""Start of the recording and the way back to the safe position."""

APPROACH_DISTANCE_MM = 4.0
"""A guess, until the skin has been found once: from the safe position to a finger on the block."""


def expected_duration_s(step: Preparation | Motion) -> float:
    """Return how long a step is expected to take, s."""
    match step:
        case Ask() | MoveStage() | WeighMass():
            seconds = step.expected_s
        case Rest():
            seconds = step.since_last_s
        case Stay():
            seconds = step.duration_s
        case Approach():
            seconds = (step.short_of_previous_mm or APPROACH_DISTANCE_MM) / step.speed_mm_s
        case RampTo():
            seconds = step.depth_mm / step.speed_mm_s
        case Retract():
            seconds = step.max_mm / step.speed_mm_s
        case Sweep():
            seconds = 2 * abs(step.to_mm - step.from_mm) / step.speed_mm_s
    return seconds


@dataclass(frozen=True, slots=True)
class Plan:
    """All that a protocol asks for, in order; `closing` puts the bench back as it was."""

    title: str
    trials: tuple[PlannedTrial, ...]
    closing: tuple[Preparation, ...] = ()

    @property
    def expected_s(self) -> float:
        """Time the whole plan is expected to take, s."""
        return sum(trial.expected_s for trial in self.trials)
