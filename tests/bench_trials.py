"""Trials of the simulated bench as the analysis knows them; the one place where both rooms meet.

In a test take the fixtures ``bench_trials`` and ``as_trial`` of conftest.py; in a script put the project's
root and then ``tests`` on the path, in that order, and import this.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta

from analysis.recordings.trial import (
    Calibration,
    Event,
    Phase,
    ProtocolSummary,
    Specimen,
    Surface,
    Trial,
)
from sim_hardware.concealment.offline import RecordedTrial, TrialPlan, record_study
from sim_hardware.settings import BenchSettings

_DAY = datetime(2024, 5, 6, 9, 0, tzinfo=UTC)


def as_trial(recorded: RecordedTrial) -> Trial:
    """Return a recorded trial as the analysis reads it from a file, without what only the bench knows."""
    c, plan = recorded.calibration, recorded.plan
    skin, sweep = plan.kind == "ramp_hold_retract", plan.kind == "air_sweep"
    labels = f"{plan} {recorded.started_s} {recorded.force_v[:8].tolist()}"
    return Trial(
        trial_id=str(uuid.uuid5(uuid.NAMESPACE_OID, labels)),
        started=(_DAY + timedelta(seconds=recorded.started_s)).isoformat(),
        kind=plan.kind,
        source="simulated",
        status="complete",
        sample_rate_hz=recorded.sample_rate_hz,
        position_v=recorded.position_v,
        force_v=recorded.force_v,
        command_v=recorded.command_v,
        calibration=Calibration(
            c.volts_per_mm,
            c.position_zero_v,
            c.volts_per_mn,
            c.force_zero_v,
            c.command_volts_per_mm,
            c.command_zero_v,
            _DAY.isoformat(),
            dict(c.standard_errors),
        ),
        phases=tuple(Phase(*p) for p in recorded.phases),
        surface=None
        if recorded.surface is None
        else Surface(
            recorded.surface.position_mm,
            recorded.surface.sample,
            recorded.surface.overshoot_um,
            recorded.surface.threshold_mn,
        ),
        protocol=ProtocolSummary(
            depth_mm=None if sweep else plan.depth_mm,
            ramp_speed_mm_s=plan.ramp_speed_mm_s,
            hold_s=None if sweep else plan.hold_s,
            dwell_s=None if sweep else plan.dwell_s,
            approach_speed_mm_s=None if sweep else plan.approach_speed_mm_s,
            retract_speed_mm_s=None if sweep else plan.retract_speed_mm_s,
            contact_threshold_mn=None if sweep else plan.contact_threshold_mn,
        ),
        specimen=Specimen(
            finger=plan.finger if skin else "",
            site=plan.site if skin else "",
            repeat=plan.repeat,
            punch_diameter_mm=0.5,
            rest_s=recorded.rest_s,
            target_stiffness_mn_per_mm=recorded.target_mn_per_mm,
        ),
        events=tuple(Event(*e) for e in recorded.events),
    )


def bench_trials(settings: BenchSettings | str, plans: Iterable[TrialPlan]) -> list[Trial]:
    """Record a study on a simulated bench (settings, or their TOML) and return its trials."""
    bench = BenchSettings.from_toml(settings) if isinstance(settings, str) else settings
    return [as_trial(recorded) for recorded in record_study(bench, plans)]
