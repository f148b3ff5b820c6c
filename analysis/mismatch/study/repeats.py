"""Which trials are repeats of one another: those that were meant alike and whose arm moved alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from string import ascii_lowercase

import numpy as np
from numpy.typing import NDArray

from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]

ALIKE = 0.05
"""Share of the travel by which repeats differ: of 0.2 mm a surface found at 4 to 12 um of overshoot takes so much."""
ALIKE_IN_TIME = 0.01
"""Share of a phase's length by which repeats differ, beside two samples."""
_PLACES = 101


@dataclass(frozen=True)
class _Leg:
    """One phase of a motion: how far (mm, from where it began) the arm was when (s, from its start or half-way)."""

    name: str
    lasted_s: float
    sample_s: float
    time_s: FloatArray
    moved_mm: FloatArray

    @property
    def travel_mm(self) -> float:
        return float(np.ptp(self.moved_mm))


def with_conditions(trials: Sequence[CellTrial]) -> list[CellTrial]:
    """Return the trials, the condition of each naming those that it repeats.

    Repeats were stated alike (kind, depth, speed, hold) and were moved alike from the ramp on: phase by phase the
    arm travelled as far in the same time. Different motions under one name are told apart by a letter.
    """
    groups: dict[str, list[tuple[list[_Leg], list[int]]]] = {}
    for j, trial in enumerate(trials):
        legs = _legs(trial)
        named = groups.setdefault(trial.condition, [])
        for first, members in named:
            if _alike(first, legs):
                members.append(j)
                break
        else:
            named.append((legs, [j]))
    found = list(trials)
    for name, motions in _worded(groups).items():
        for letter, members in zip(_letters(len(motions)), motions, strict=True):
            for j in members:
                found[j] = replace(trials[j], condition=f"{name} {letter}".strip())
    return found


def _worded(groups: dict[str, list[tuple[list[_Leg], list[int]]]]) -> dict[str, list[list[int]]]:
    """Name motions of which nothing was stated by what was measured; stated names stay."""
    named: dict[str, list[list[int]]] = {}
    for name, motions in groups.items():
        for legs, members in motions:
            stated = any(character.isdigit() for character in name)
            named.setdefault(name if stated else " ".join([name, *_words(legs)]), []).append(members)
    return named


def _words(legs: Sequence[_Leg]) -> list[str]:
    by_name = {leg.name: leg for leg in legs}
    words = []
    if "ramp" in by_name:
        ramp = by_name["ramp"]
        words = [f"{_short(ramp.travel_mm)} mm", f"{_short(ramp.travel_mm / ramp.lasted_s)} mm/s"]
    if "hold" in by_name:
        words.append(f"{_short(by_name['hold'].lasted_s)} s")
    return words or [f"{_short(leg.lasted_s)} s" for leg in legs[:1]]


def _short(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


def _letters(count: int) -> list[str]:
    if count == 1:
        return [""]
    return [f"motion {ascii_lowercase[k] if k < 26 else k + 1}" for k in range(count)]


def _legs(trial: CellTrial) -> list[_Leg]:
    """Return ramp, hold and retract, or the sweep; the retract as far as it leaves the indentation."""
    legs: list[_Leg] = []
    for name in ("sweep", "ramp", "hold", "retract"):
        cells = np.flatnonzero(trial.in_phase(name))
        if not len(cells):
            continue
        began_s, ended_s = trial.span_s(cells)
        moving = name in ("ramp", "retract")
        # a move with its neighbours, so that it begins and ends at rest however few its samples are
        inside = slice(max(cells[0] - 1, 0), cells[-1] + 2) if moving else slice(cells[0], cells[-1] + 1)
        time_s, position_mm = trial.time_s[inside], trial.position_mm[inside]
        moved_mm = position_mm - (position_mm[0] if moving else np.median(position_mm))
        travel_mm = legs[0].travel_mm if name == "retract" and legs else float(np.ptp(moved_mm))
        if name == "retract":
            kept = moved_mm >= -travel_mm
            time_s, moved_mm = time_s[kept], moved_mm[kept]
        if len(time_s) > 1:
            zero_s = _half_way(time_s, moved_mm, travel_mm) if moving else float(time_s[0])
            legs.append(_Leg(name, ended_s - began_s, 1.0 / trial.sample_rate_hz, time_s - zero_s, moved_mm))
    return legs


def _half_way(time_s: FloatArray, moved_mm: FloatArray, travel_mm: float) -> float:
    """Return when half of the way was gone (s), between samples: no phase's first sample is to decide."""
    gone_mm = np.maximum.accumulate(np.abs(moved_mm))
    return float(np.interp(0.5 * travel_mm, gone_mm, time_s))


def _alike(one: Sequence[_Leg], other: Sequence[_Leg]) -> bool:
    if [leg.name for leg in one] != [leg.name for leg in other]:
        return False
    travel_mm = max((leg.travel_mm for leg in (*one, *other)), default=0.0)
    return all(_leg_alike(a, b, travel_mm) for a, b in zip(one, other, strict=True))


def _leg_alike(one: _Leg, other: _Leg, travel_mm: float) -> bool:
    sample_s = max(one.sample_s, other.sample_s)
    lasted_s = (one.lasted_s, other.lasted_s)
    # how long a ramp lasted its path shows, but not how long the arm rested
    rested = one.name == "hold"
    if rested and abs(lasted_s[0] - lasted_s[1]) > 2.0 * sample_s + ALIKE_IN_TIME * max(lasted_s):
        return False
    span_s = min(one.time_s[0], other.time_s[0]), max(one.time_s[-1], other.time_s[-1])
    grid_s = np.linspace(*span_s, _PLACES)
    paths_mm = [np.interp(grid_s, leg.time_s, leg.moved_mm) for leg in (one, other)]
    # within a sample nobody knows where the arm turned
    fastest_mm_s = max(
        float(np.abs(np.diff(leg.moved_mm) / np.diff(leg.time_s)).max()) for leg in (one, other)
    )
    off_mm = float(np.abs(paths_mm[0] - paths_mm[1]).max())
    return off_mm <= ALIKE * travel_mm + 0.5 * sample_s * fastest_mm_s
