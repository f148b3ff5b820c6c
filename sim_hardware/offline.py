"""Whole trials and studies straight from a world, without a card: for campaigns of hundreds of studies.

Everything a trial file needs comes back in memory; nothing is written.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sim_hardware.parts import SAMPLE_RATE_HZ, FloatArray
from sim_hardware.settings import BenchSettings
from sim_hardware.world import Readings, World

Kind = Literal["ramp_hold_retract", "rigid_target", "air_sweep"]

_PARK_MM = 1.0
_FAST_MM_S = 20.0
_LIMIT_MM = 9.5
_READ = 16
"""Samples read at a time during the approach."""
_WINDOW, _ENOUGH = 5, 3
"""So many of so many samples above the threshold are a surface."""


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


@dataclass(frozen=True, slots=True)
class FoundCalibration:
    """Constants as a calibration of this bench gave them, with their standard errors."""

    volts_per_mm: float
    position_zero_v: float
    volts_per_mn: float
    force_zero_v: float
    command_volts_per_mm: float
    command_zero_v: float
    standard_errors: Mapping[str, float]


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


def true_calibration(world: World) -> FoundCalibration:
    """Return the bench's true constants."""
    c = world.constants
    return FoundCalibration(
        c.volts_per_mm,
        c.position_zero_v,
        c.volts_per_mn,
        c.force_zero_v,
        c.command_volts_per_mm,
        c.command_zero_v,
        {},
    )


def found_calibration(world: World) -> FoundCalibration:
    """Return constants with the errors of a good calibration, drawn from the bench's seed."""
    random = np.random.default_rng([world.settings.seed, 7])
    c = world.constants
    errors = {
        "volts_per_mm": 1e-4 * c.volts_per_mm,
        "position_zero_v": 1e-3,
        "volts_per_mn": 1e-3 * c.volts_per_mn,
        "force_zero_v": 2e-3,
        "command_volts_per_mm": 1e-4 * c.command_volts_per_mm,
        "command_zero_v": 1e-3,
    }
    values = {k: float(getattr(c, k) + e * random.standard_normal()) for k, e in errors.items()}
    return FoundCalibration(**values, standard_errors=errors)


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
