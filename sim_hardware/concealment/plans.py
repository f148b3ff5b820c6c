"""What a trial and a study do; the published ones by default."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

Kind = Literal["ramp_hold_retract", "rigid_target", "air_sweep"]


@dataclass(frozen=True, slots=True)
class TrialPlan:
    """What one trial does; defaults are the published ones.

    ``short_mm``: how far short of the surface the trial begins. ``rest_s``: time before it, the arm parked.
    ``surface_mm`` asks the hands for a finger at that height (None: as it comes).
    ``sweep_mm`` and ``ramp_speed_mm_s`` are the span and speed of an air sweep. ``depth_mm`` counts from
    the detected surface.
    """

    kind: Kind = "ramp_hold_retract"
    finger: str = "index"
    site: str = ""
    repeat: int = 1
    surface_mm: float | None = None
    depth_mm: float = 0.6
    ramp_speed_mm_s: float = 5.0
    hold_s: float = 7.0
    dwell_s: float = 2.0
    approach_speed_mm_s: float = 1.0
    retract_speed_mm_s: float = 5.0
    contact_threshold_mn: float = 10.0
    short_mm: float = 0.5
    clear_s: float = 0.4
    rest_s: float = 150.0
    latency_s: tuple[float, float] = (0.004, 0.009)
    sweep_mm: tuple[float, float] = (2.0, 8.0)


def rigid_plan(**changes: float | int | str) -> TrialPlan:
    """Return a plan for the stiff block: slower and shallower, so that its force stays within the range."""
    plan = TrialPlan(
        kind="rigid_target", depth_mm=0.012, ramp_speed_mm_s=0.5, approach_speed_mm_s=0.2, hold_s=3.0
    )
    return replace(plan, **changes)  # type: ignore[arg-type]


def study_plans(
    fingers: Sequence[str] = ("index",),
    depths_mm: Sequence[float] = (0.2, 0.4, 0.6, 0.8),
    repeats: int = 5,
    **changes: float,
) -> list[TrialPlan]:
    """Return the plans of a study: every finger at every depth, each repeat at a site of its own."""
    plans = []
    for finger in fingers:
        for i, depth_mm in enumerate(depths_mm):
            for repeat in range(1, repeats + 1):
                site = f"s{i * repeats + repeat}"
                plan = TrialPlan(finger=finger, site=site, repeat=repeat, depth_mm=depth_mm)
                plans.append(replace(plan, **changes))  # type: ignore[arg-type]
    return plans
