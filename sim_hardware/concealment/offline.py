"""Whole trials and studies straight from a world, without a card: for campaigns of hundreds of studies.

Everything a trial file needs comes back in memory; nothing is written.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sim_hardware.concealment.found import FoundCalibration, found_calibration, true_calibration
from sim_hardware.concealment.plans import TrialPlan, rigid_plan, study_plans
from sim_hardware.parts import SAMPLE_RATE_HZ, FloatArray
from sim_hardware.settings import BenchSettings
from sim_hardware.world import Readings, World

__all__ = ["RecordedTrial", "TrialPlan", "record_study", "record_trial", "rigid_plan", "study_plans"]

_PARK_MM = 1.0
_FAST_MM_S = 20.0
_LIMIT_MM = 9.5
_READ = 16
"""Samples read at a time during the approach."""
_WINDOW, _ENOUGH = 5, 3
"""So many of so many samples above the threshold are a surface."""


@dataclass(frozen=True, slots=True)
class FoundSurface:
    """Where the approach found the surface, in lever coordinates."""

    position_mm: float
    sample: int
    overshoot_um: float
    threshold_mn: float


@dataclass(frozen=True, slots=True)
class RecordedTrial:
    """A trial as recorded: volts, phases (name, start, stop), and all that is written beside them.

    ``truth`` is what the bench knows and a recording does not.
    """

    plan: TrialPlan
    sample_rate_hz: float
    position_v: FloatArray
    force_v: FloatArray
    command_v: FloatArray
    phases: tuple[tuple[str, int, int], ...]
    calibration: FoundCalibration
    surface: FoundSurface | None
    rest_s: float | None
    target_mn_per_mm: float | None
    started_s: float
    events: tuple[tuple[int, str, str], ...]
    truth: Mapping[str, object]


class _Recorder:
    """Moves the arm by straight lines and keeps what was played and read."""

    def __init__(self, world: World, calibration: FoundCalibration) -> None:
        self.world = world
        self.calibration = calibration
        self.at_mm = (world.arm().command_v - calibration.command_zero_v) / calibration.command_volts_per_mm
        self.played: list[FloatArray] = []
        self.read: list[Readings] = []
        self.phases: list[tuple[str, int, int]] = []
        self.n = 0

    def path(self, to_mm: float, speed_mm_s: float) -> FloatArray:
        """Return the command of a straight line, samples after now, mm."""
        n = max(round(abs(to_mm - self.at_mm) / speed_mm_s * SAMPLE_RATE_HZ), 1)
        return self.at_mm + (to_mm - self.at_mm) * np.arange(1, n + 1) / n

    def play(self, command_mm: FloatArray) -> Readings:
        c = self.calibration
        command_v = c.command_zero_v + c.command_volts_per_mm * command_mm
        readings = self.world.advance(command_v)
        self.played.append(command_v)
        self.read.append(readings)
        self.n += len(command_v)
        self.at_mm = float(command_mm[-1])
        return readings

    def phase(self, name: str, command_mm: FloatArray) -> None:
        start = self.n
        self.play(command_mm)
        self.phases.append((name, start, self.n))

    def hold(self, duration_s: float) -> FloatArray:
        return np.full(max(round(duration_s * SAMPLE_RATE_HZ), 1), self.at_mm)

    def forget(self) -> None:
        """Drop what was recorded so far."""
        self.played, self.read, self.phases, self.n = [], [], [], 0


def record_trial(
    world: World, plan: TrialPlan, *, calibration: FoundCalibration | None = None, first: bool = False
) -> RecordedTrial:
    """Rest, place the specimen, and record one trial.

    ``calibration`` defaults to the true constants. ``first`` leaves out the rest before it. ValueError where
    no surface is found within the travel.
    """
    found = calibration or true_calibration(world)
    recorder = _Recorder(world, found)
    recorder.play(recorder.path(_PARK_MM, _FAST_MM_S))
    if not first:
        world.rest(plan.rest_s)
    _place(world, plan)
    sweep = plan.kind == "air_sweep"
    random = np.random.default_rng([world.settings.seed, 6, world.trial])
    short_mm = plan.short_mm * float(random.uniform(0.8, 1.2))
    start_mm = plan.sweep_mm[0] if sweep else world.specimen.surface_mm - short_mm
    recorder.play(recorder.path(start_mm, _FAST_MM_S))
    recorder.play(recorder.hold(0.2))
    recorder.forget()
    world.begin_trial()
    started_s = world.time_s
    surface = None
    if sweep:
        out = recorder.path(plan.sweep_mm[1], plan.ramp_speed_mm_s)
        back = out[::-1] - (out[-1] - out[-2])
        recorder.phase("sweep", np.concatenate([out, back]))
    else:
        surface = _approach(recorder, plan, float(random.uniform(*plan.latency_s)))
        recorder.phase("dwell", recorder.hold(plan.dwell_s))
        recorder.phase("ramp", recorder.path(surface.position_mm + plan.depth_mm, plan.ramp_speed_mm_s))
        recorder.phase("hold", recorder.hold(plan.hold_s))
        recorder.phase("retract", recorder.path(start_mm, plan.retract_speed_mm_s))
        recorder.phase("clear", recorder.hold(plan.clear_s))
    rigid = plan.kind == "rigid_target"
    return RecordedTrial(
        plan=plan,
        sample_rate_hz=SAMPLE_RATE_HZ,
        position_v=np.concatenate([r.position_v for r in recorder.read]),
        force_v=np.concatenate([r.force_v for r in recorder.read]),
        command_v=np.concatenate(recorder.played),
        phases=tuple(recorder.phases),
        calibration=found,
        surface=surface,
        rest_s=None if first else plan.rest_s,
        target_mn_per_mm=world.settings.specimens.block_mn_per_mm if rigid else None,
        started_s=started_s,
        events=(),
        truth=world.truth(),
    )


def record_study(
    settings: BenchSettings, plans: Iterable[TrialPlan], *, calibration: Literal["true", "found"] = "true"
) -> list[RecordedTrial]:
    """Record a study on a fresh bench, trial after trial with their rests.

    ``found`` takes constants that are off by what a good calibration leaves (1e-4 of length, 1e-3 of force).
    """
    world = World(settings)
    constants = true_calibration(world) if calibration == "true" else found_calibration(world)
    return [record_trial(world, plan, calibration=constants, first=i == 0) for i, plan in enumerate(plans)]


def _place(world: World, plan: TrialPlan) -> None:
    if plan.kind == "air_sweep":
        world.request("clear_air")
    elif plan.kind == "rigid_target":
        world.request("place_block")
    else:
        details: dict[str, object] = {"finger": plan.finger, "site": plan.site, "repeat": plan.repeat}
        if plan.surface_mm is not None:
            details["surface_mm"] = plan.surface_mm
        world.request("place_finger", details)


def _approach(recorder: _Recorder, plan: TrialPlan, latency_s: float) -> FoundSurface:
    """Approach until the force is above the threshold, as a host does that reads a few samples at a time.

    The output plays on for the host's latency after the samples that told; then it stops.
    """
    c = recorder.calibration
    rest = recorder.play(recorder.hold(0.1))
    tare_v = float(np.mean(rest.force_v))
    threshold_v = plan.contact_threshold_mn * c.volts_per_mn
    path = recorder.path(_LIMIT_MM, plan.approach_speed_mm_s)
    above: list[bool] = []
    at = 0
    while at < len(path):
        readings = recorder.play(path[at : at + _READ])
        at += _READ
        before = len(above)
        above.extend(bool(a) for a in readings.force_v - tare_v > threshold_v)
        for i in range(max(before, _WINDOW - 1), len(above)):
            if sum(above[i - _WINDOW + 1 : i + 1]) >= _ENOUGH:
                sample = recorder.n - len(above) + i
                position_v = float(readings.position_v[i - before])
                position_mm = (position_v - c.position_zero_v) / c.volts_per_mm
                recorder.play(path[at : at + round(latency_s * SAMPLE_RATE_HZ)])
                recorder.phases.append(("approach", 0, recorder.n))
                overshoot_um = (recorder.at_mm - position_mm) * 1e3
                return FoundSurface(position_mm, sample, overshoot_um, plan.contact_threshold_mn)
    raise ValueError(f"no surface was found up to {_LIMIT_MM} mm")
