"""What a protocol would do, worked out before anything moves."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np

from analysis.recordings.trial import FloatArray
from rig.protocols.planning import plan_of
from rig.protocols.steps import (
    APPROACH_DISTANCE_MM,
    Approach,
    Ask,
    Motion,
    PlannedTrial,
    RampTo,
    Rest,
    Retract,
    Stay,
    Sweep,
    WeighMass,
)
from rig.settings.reading import parse_protocol
from rig.settings.rig_file import RigFile

_MOST_MOTIONS = 60


@dataclass(frozen=True, slots=True)
class Leg:
    """One straight stretch of a planned motion: phase, where it begins and ends, s and mm, and its speed."""

    phase: str
    start_s: float
    stop_s: float
    start_mm: float
    stop_mm: float

    @property
    def speed_mm_s(self) -> float:
        """Speed, mm/s, 0 at rest."""
        length_s = self.stop_s - self.start_s
        return abs(self.stop_mm - self.start_mm) / length_s if length_s > 0 else 0.0


@dataclass(frozen=True, slots=True)
class PlannedMotion:
    """One kind of trial in the plan: what it does, how often, and what of it is beyond the rig's limits."""

    title: str
    n_trials: int
    legs: tuple[Leg, ...]
    beyond: tuple[str, ...]

    @property
    def path(self) -> tuple[FloatArray, FloatArray]:
        """Corners of the motion: times (N,) s and positions (N,) mm in lever coordinates."""
        if not self.legs:
            return np.empty(0), np.empty(0)
        times = [self.legs[0].start_s, *(leg.stop_s for leg in self.legs)]
        places = [self.legs[0].start_mm, *(leg.stop_mm for leg in self.legs)]
        return np.array(times), np.array(places)


@dataclass(frozen=True, slots=True)
class Preview:
    """A plan in short. ``surface_mm`` is where the skin was taken to lie; nobody knows before it is found."""

    n_trials: int
    expected_s: float
    rest_s: float
    hands: tuple[tuple[str, int], ...]
    motions: tuple[PlannedMotion, ...]
    surface_mm: float


def usual_surface_mm(rig: RigFile) -> float:
    """Return where the skin usually lies: as far below the safe position as the plan of time assumes."""
    lever = rig.lever
    return min(
        lever.safe_position_mm + APPROACH_DISTANCE_MM, 0.5 * (lever.travel_min_mm + lever.travel_max_mm) + 2
    )


def preview_protocol(toml: str, rig: RigFile, surface_mm: float) -> Preview:
    """Return what a protocol would do on a rig whose skin lies at ``surface_mm``; BadInputError as `parse_protocol`."""
    plan = plan_of(parse_protocol(toml, "the protocol"), rig.punch.diameter_mm, toml)
    titles: dict[tuple[Motion, ...], PlannedTrial] = {}
    counts: Counter[tuple[Motion, ...]] = Counter()
    hands: Counter[str] = Counter()
    rest_s = 0.0
    for trial in plan.trials:
        titles.setdefault(trial.motions, trial)
        counts[trial.motions] += 1
        for step in trial.preparations:
            if isinstance(step, Rest):
                rest_s += step.since_last_s
            elif isinstance(step, Ask | WeighMass):
                hands[step.request.replace("_", " ") if isinstance(step, Ask) else "hang a weight"] += 1
    motions = []
    for steps, trial in list(titles.items())[:_MOST_MOTIONS]:
        legs = _legs(steps, rig, surface_mm)
        beyond = _beyond(legs, steps, rig, surface_mm)
        motions.append(PlannedMotion(_title(trial), counts[steps], legs, beyond))
    return Preview(
        len(plan.trials), plan.expected_s, rest_s, tuple(hands.most_common()), tuple(motions), surface_mm
    )


def _title(trial: PlannedTrial) -> str:
    summary = trial.summary
    parts = [trial.kind.replace("_", " ")]
    if summary.depth_mm is not None:
        parts.append(f"{summary.depth_mm:g} mm")
    if summary.ramp_speed_mm_s is not None:
        parts.append(f"at {summary.ramp_speed_mm_s:g} mm/s")
    if summary.hold_s is not None:
        parts.append(f"hold {summary.hold_s:g} s")
    return ", ".join(parts)


def _legs(steps: tuple[Motion, ...], rig: RigFile, surface_mm: float) -> tuple[Leg, ...]:
    legs: list[Leg] = []
    time_s, place_mm = 0.0, rig.lever.safe_position_mm

    def go(phase: str, to_mm: float, speed_mm_s: float) -> None:
        nonlocal time_s, place_mm
        stop_s = time_s + abs(to_mm - place_mm) / speed_mm_s
        legs.append(Leg(phase, time_s, stop_s, place_mm, to_mm))
        time_s, place_mm = stop_s, to_mm

    for step in steps:
        match step:
            case Approach():
                near = surface_mm - step.short_of_previous_mm if step.short_of_previous_mm else None
                start_mm = step.start_mm if step.start_mm is not None else near
                place_mm = min(place_mm if start_mm is None else start_mm, surface_mm)
                go("approach", surface_mm, step.speed_mm_s)
            case Stay():
                legs.append(Leg(step.phase, time_s, time_s + step.duration_s, place_mm, place_mm))
                time_s += step.duration_s
            case RampTo():
                go("ramp", surface_mm + step.depth_mm, step.speed_mm_s)
            case Retract():
                go("retract", max(rig.lever.travel_min_mm, surface_mm - step.max_mm), step.speed_mm_s)
            case Sweep():
                place_mm = step.from_mm
                go("sweep", step.to_mm, step.speed_mm_s)
                go("sweep", step.from_mm, step.speed_mm_s)
    return tuple(legs)


def _beyond(
    legs: tuple[Leg, ...], steps: tuple[Motion, ...], rig: RigFile, surface_mm: float
) -> tuple[str, ...]:
    lever = rig.lever
    found = []
    for leg in legs:
        if leg.speed_mm_s > lever.speed_max_mm_s * (1 + 1e-9):
            found.append(
                f"{leg.phase} at {leg.speed_mm_s:g} mm/s: this rig allows {lever.speed_max_mm_s:g} mm/s"
            )
    deepest_mm = max((leg.stop_mm for leg in legs), default=surface_mm)
    depth_mm = max((step.depth_mm for step in steps if isinstance(step, RampTo)), default=0.0)
    if depth_mm > lever.depth_max_mm * (1 + 1e-9):
        found.append(f"presses {depth_mm:g} mm deep: this rig allows {lever.depth_max_mm:g} mm")
    if deepest_mm > lever.travel_max_mm:
        found.append(
            f"reaches {deepest_mm:.2f} mm, the travel ends at {lever.travel_max_mm:g} mm: "
            f"the skin must lie above {lever.travel_max_mm - depth_mm:.2f} mm"
        )
    lowest_mm = min((min(leg.start_mm, leg.stop_mm) for leg in legs), default=surface_mm)
    if lowest_mm < lever.travel_min_mm:
        found.append(f"begins at {lowest_mm:.2f} mm, the travel begins at {lever.travel_min_mm:g} mm")
    return tuple(dict.fromkeys(found))
