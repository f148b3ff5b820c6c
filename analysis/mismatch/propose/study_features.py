"""What a study on this rig can have besides its plain trials, and the trials that it adds."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from analysis.mismatch.diagnosis import Diagnosis
from analysis.mismatch.model.words import listed
from analysis.mismatch.propose.planned import PlannedTrial
from analysis.simulation.cells import CellTrial

SKIN_TRIALS = 8
TRAVEL_MM = (0.0, 9.5)
LONG_HOLD = 4.0
LONGEST_HOLD_S = 60.0
RAMP_SPEEDS_MM_S = (1.0, 5.0, 20.0)
SWEEP_SPEEDS_MM_S = (1.0, 5.0, 20.0)
SURFACES_MM = (2.0, 4.5, 7.0)
BLOCK_DEPTHS_MM = tuple(round(0.010 + 0.0003 * k, 4) for k in range(12))
"""Twelve, of much the same force: sign-flips count trials, and a trial that shows little counts little. 13 um into a
block are some 260 mN."""
BLOCK_SPEED_MM_S = 0.5
MOST_DEPTHS = 4


@dataclass(frozen=True)
class Feature:
    """Something a study can have besides its plain trials: settings of [study], and the trials they add."""

    name: str
    words: str
    settings: dict[str, Any]
    trials: tuple[PlannedTrial, ...]
    repeated: bool = True


def plain_study(diagnosis: Diagnosis) -> tuple[Feature, int]:
    """Return the plain study like the one that was recorded, and how often it is repeated."""
    skin = [j for j, t in enumerate(diagnosis.intake.trials) if t.kind == "ramp_hold_retract"]
    trials = [diagnosis.intake.trials[j] for j in skin]
    depths = sorted({round(_nominal(t, "mm", t.depth_mm), 3) for t in trials})
    if len(depths) > MOST_DEPTHS:
        depths = [depths[i] for i in np.linspace(0, len(depths) - 1, MOST_DEPTHS).round().astype(int)]
    z0 = float(np.median([diagnosis.improved.fit.states[j].z0_mm for j in skin]))
    speed = float(np.median([_nominal(t, "mm/s", 5.0) for t in trials]))
    hold = float(np.median([_nominal(t, "s", t.hold_window_s[1] - t.hold_window_s[0]) for t in trials]))
    hold = min(max(round(hold, 2), 0.5), LONGEST_HOLD_S)
    plans = tuple(
        PlannedTrial(z0_mm=z0, depth_mm=d, ramp_speed_mm_s=speed, hold_s=hold, previous_depth_mm=max(depths))
        for d in depths
    )
    return Feature("plain", "the same again", {}, plans), max(1, int(np.ceil(SKIN_TRIALS / len(depths))))


def _nominal(trial: CellTrial, unit: str, otherwise: float) -> float:
    """Return a number of the trial's condition by its unit, as its protocol had it."""
    found = re.search(rf"([\d.e+-]+) {re.escape(unit)}(?= |$)", trial.condition)
    value = float(found.group(1)) if found else otherwise
    return value if value > 0 else max(otherwise, 0.05)


def study_features(diagnosis: Diagnosis, base: Feature) -> list[Feature]:
    """Return everything that could be added to a plain study."""
    first = base.trials[0]
    deepest = max(base.trials, key=lambda p: p.depth_mm)
    speeds = tuple(s for s in RAMP_SPEEDS_MM_S if s != first.ramp_speed_mm_s)
    hold = min(LONG_HOLD * first.hold_s, LONGEST_HOLD_S)
    surfaces = tuple(z for z in SURFACES_MM if z + deepest.depth_mm < TRAVEL_MM[1] - 0.3)
    found = [
        Feature(
            "rigid_target",
            "a run on a rigid target",
            {"rigid_target": True, "rigid_target_depths_mm": list(BLOCK_DEPTHS_MM)},
            tuple(
                replace(first, kind="rigid_target", z0_mm=4.5, depth_mm=d, ramp_speed_mm_s=BLOCK_SPEED_MM_S,
                        approach_speed_mm_s=0.2, hold_s=2.0)
                for d in BLOCK_DEPTHS_MM
            ),
            repeated=False,
        ),
        Feature(
            "air_sweep",
            f"air sweeps at {listed([f'{s:g}' for s in SWEEP_SPEEDS_MM_S])} mm/s",
            {"air_sweep_speeds_mm_s": list(SWEEP_SPEEDS_MM_S)},
            tuple(replace(first, kind="air_sweep", ramp_speed_mm_s=s) for s in SWEEP_SPEEDS_MM_S),
            repeated=False,
        ),
        Feature(
            "ramp_speeds",
            f"ramps at {listed([f'{s:g}' for s in sorted({*speeds, first.ramp_speed_mm_s})])} mm/s",
            {"ramp_speeds_mm_s": sorted({*speeds, first.ramp_speed_mm_s})},
            tuple(replace(p, ramp_speed_mm_s=s) for s in speeds for p in base.trials),
        ),
    ]  # fmt: skip
    if hold > 1.5 * first.hold_s:
        found.append(
            Feature(
                "long_hold",
                f"a hold of {hold:g} s beside that of {first.hold_s:g} s",
                {"holds_s": [first.hold_s, hold]},
                tuple(replace(p, hold_s=hold) for p in base.trials),
            )
        )
    if len(surfaces) == len(SURFACES_MM):
        found.append(
            Feature(
                "surface_heights",
                f"the skin at three heights, {listed([f'{z:g}' for z in surfaces])} mm of travel",
                {"surface_positions_mm": list(surfaces)},
                tuple(replace(p, z0_mm=z) for z in surfaces for p in base.trials),
            )
        )
    found.append(
        Feature(
            "rests",
            "rests between 10 and 180 s in shuffled order",
            {"rest_s": [10.0, 180.0], "order": "shuffled"},
            tuple(
                replace(deepest, rest_s=r, previous_depth_mm=d)
                for r in (10.0, 60.0)
                for d in (first.depth_mm, deepest.depth_mm)
            ),
        )
    )  # fmt: skip
    return found
