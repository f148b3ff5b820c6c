"""The study: which finger, depth, speed, hold and height comes when, and how long the finger rests before."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from analysis.recordings.trial import Specimen
from rig.protocols.indenting import indentation, place_block, place_finger
from rig.protocols.steps import PlannedTrial, Preparation, Rest
from rig.protocols.sweeping import air_sweeps
from rig.settings.protocol_file import Study, StudyPlan

_SWEEP_MM = (1.0, 9.0)


@dataclass(frozen=True, slots=True)
class Cell:
    """One indentation of the study's design."""

    finger: str
    surface_position_mm: float | None
    ramp_speed_mm_s: float
    hold_s: float
    depth_mm: float
    repeat: int


def design(study: Study) -> tuple[Cell, ...]:
    """Return every indentation in the order of the run.

    Fixed: finger by finger, then height, speed, hold, depth, repeat, as listed. Shuffled: the order of the
    fingers and the order within each finger are drawn from the seed, so that a finger is placed once.
    """
    plan, motion = study.study, study.indentation
    random = np.random.default_rng([plan.seed, 1])
    fingers = list(plan.fingers)
    if plan.order == "shuffled":
        random.shuffle(fingers)
    cells: list[Cell] = []
    for finger in fingers:
        of_finger = [
            Cell(finger, *values)
            for values in product(
                plan.surface_positions_mm or (None,),
                plan.ramp_speeds_mm_s or (motion.ramp_speed_mm_s,),
                plan.holds_s or (motion.hold_s,),
                plan.depths_mm,
                range(1, plan.repeats + 1),
            )
        ]
        if plan.order == "shuffled":
            random.shuffle(of_finger)
        cells += of_finger
    return tuple(cells)


def number_of_trials(study: Study) -> int:
    """Return how many trials a study asks for, without making a list of them."""
    plan = study.study
    n = len(plan.fingers) * len(plan.depths_mm) * plan.repeats
    for values in (plan.surface_positions_mm, plan.ramp_speeds_mm_s, plan.holds_s):
        n *= len(values) if values else 1
    return n + len(plan.air_sweep_speeds_mm_s) + len(plan.rigid_target_depths_mm) * plan.rigid_target


def rests_s(plan: StudyPlan, n: int) -> tuple[float, ...]:
    """Return the rest before each of n indentations, s, drawn evenly from the seed; the first has none."""
    low_s, high_s = plan.rest_s if isinstance(plan.rest_s, tuple) else (plan.rest_s, plan.rest_s)
    drawn = np.random.default_rng([plan.seed, 2]).uniform(low_s, high_s, size=n)
    return (0.0, *(float(round(rest, 1)) for rest in drawn[1:]))


def study_trials(study: Study, punch_diameter_mm: float, toml: str) -> tuple[PlannedTrial, ...]:
    """Return the trials of the study: sweeps and block first, where asked for, then the fingers."""
    plan = study.study
    specimen = Specimen(subject=plan.subject, punch_diameter_mm=punch_diameter_mm)
    trials = list(air_sweeps(plan.air_sweep_speeds_mm_s, *_SWEEP_MM, specimen=specimen, toml=toml))
    if plan.rigid_target:
        trials += _on_block(study, specimen, toml)
    cells = design(study)
    sites: dict[str, int] = dict.fromkeys(plan.fingers, 0)
    for i, (cell, rest_s) in enumerate(zip(cells, rests_s(plan, len(cells)), strict=True)):
        sites[cell.finger] += 1
        site = str(sites[cell.finger])
        placed = place_finger(cell.finger, site, cell.repeat, cell.surface_position_mm)
        before: tuple[Preparation, ...] = (placed, Rest(rest_s)) if rest_s else (placed,)
        motion = study.indentation.model_copy(
            update={"ramp_speed_mm_s": cell.ramp_speed_mm_s, "hold_s": cell.hold_s}
        )
        whose = replace(specimen, finger=cell.finger, site=site, repeat=cell.repeat)
        name = f"{i + 1:03d}_{cell.finger}_{cell.depth_mm:.2f}mm_r{cell.repeat}"
        trials.append(
            indentation(
                name, before, study.surface, motion, depth_mm=cell.depth_mm, specimen=whose, toml=toml
            )
        )
    return tuple(trials)


def _on_block(study: Study, specimen: Specimen, toml: str) -> list[PlannedTrial]:
    """Return the indentations of the block, one a depth."""
    trials = []
    for i, depth_mm in enumerate(study.study.rigid_target_depths_mm):
        before = (place_block(first=i == 0),)
        name = f"rigid_target_{i + 1:02d}_{1e3 * depth_mm:g}um"
        trials.append(
            indentation(
                name,
                before,
                study.surface,
                study.indentation,
                depth_mm=depth_mm,
                specimen=specimen,
                toml=toml,
                rigid=True,
            )
        )
    return trials
