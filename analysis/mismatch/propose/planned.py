"""Trials that were not recorded yet, as cells: what a protocol would look like to the simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import Calibration, Phase, ProtocolSummary, Trial
from analysis.simulation.cells import CellTrial
from analysis.simulation.motion import Motion
from analysis.simulation.reduction import reduce_trial
from analysis.simulation.servo import follow

FloatArray = NDArray[np.float64]

SHORT_MM = 0.3
CLEAR_S = 0.3
CONTACT_MN_PER_MM = 120.0
SWEEP_MM = (1.0, 9.0)


@dataclass(frozen=True, slots=True)
class PlannedTrial:
    """One trial of a protocol; ``z0_mm`` is where the surface lies."""

    kind: Literal["ramp_hold_retract", "rigid_target", "air_sweep"] = "ramp_hold_retract"
    z0_mm: float = 4.5
    depth_mm: float = 0.6
    ramp_speed_mm_s: float = 5.0
    hold_s: float = 7.0
    dwell_s: float = 2.0
    retract_speed_mm_s: float = 5.0
    approach_speed_mm_s: float = 1.0
    rest_s: float = 150.0
    previous_depth_mm: float = 0.6


def planned_cells(plan: PlannedTrial, sample_rate_hz: float, order: int = 0) -> CellTrial:
    """Return a planned trial as cells: its command through the nominal servo, cut where things happen."""
    moves: list[tuple[str, float, float]]
    if plan.kind == "air_sweep":
        start = SWEEP_MM[0]
        moves = [("sweep", SWEEP_MM[1], plan.ramp_speed_mm_s), ("sweep", start, plan.ramp_speed_mm_s)]
    else:
        start = plan.z0_mm - SHORT_MM
        moves = [
            ("approach", plan.z0_mm, plan.approach_speed_mm_s),
            ("dwell", plan.z0_mm, plan.dwell_s),
            ("ramp", plan.z0_mm + plan.depth_mm, plan.ramp_speed_mm_s),
            ("hold", plan.z0_mm + plan.depth_mm, plan.hold_s),
            ("retract", start, plan.retract_speed_mm_s),
            ("clear", start, CLEAR_S),
        ]
    path, at, n = [np.array([start])], start, 1
    phases: list[Phase] = []
    for name, to, speed_or_time in moves:
        seconds = abs(to - at) / speed_or_time if to != at else speed_or_time
        count = max(2, round(seconds * sample_rate_hz))
        path.append(at + (to - at) * np.arange(1, count + 1) / count)
        if phases and phases[-1].name == name:
            phases[-1] = Phase(name, phases[-1].start, n + count)
        else:
            phases.append(Phase(name, n if phases else 0, n + count))
        n, at = n + count, to
    command = np.concatenate(path)
    servo = follow(command, sample_rate_hz)
    position = servo.position_mm
    force = CONTACT_MN_PER_MM * np.maximum(position - plan.z0_mm, 0.0)
    sweep = plan.kind == "air_sweep"
    trial = Trial(
        trial_id="planned",
        started="",
        kind=plan.kind,
        source="simulated",
        status="complete",
        sample_rate_hz=sample_rate_hz,
        position_v=position,
        force_v=force,
        command_v=command,
        calibration=Calibration(1.0, 0.0, 1.0, 0.0, 1.0, 0.0),
        phases=tuple(phases),
        protocol=ProtocolSummary(
            depth_mm=None if sweep else plan.depth_mm,
            ramp_speed_mm_s=plan.ramp_speed_mm_s,
            hold_s=None if sweep else plan.hold_s,
        ),
    )
    kinks = [0, *(p.start for p in phases), n - 1]
    if sweep:
        kinks.append((n - 1) // 2)
    motion = Motion(
        position_mm=position,
        velocity_mm_s=servo.velocity_mm_s,
        acceleration_mm_s2=servo.acceleration_mm_s2,
        shake_mm_s2=np.zeros((n, 2)),
        servo_residual_mm=np.zeros(n),
        servo_signature_mm=np.zeros((n, 2)),
        kinks=np.array(sorted(set(kinks)), dtype=np.int64),
        position_error_mm=np.zeros(n),
        noise_mm=0.0,
        beside_servo_mm=np.zeros(n),
    )
    return reduce_trial(trial, motion, order=order, pressed_before=(plan.previous_depth_mm, plan.rest_s))
