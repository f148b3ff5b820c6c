"""What a trial's file says from its beginning."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime
from uuid import uuid4

from analysis.recordings.trial import Calibration, Kind, ProtocolSummary, Source, Specimen


def _now() -> str:
    return datetime.now().astimezone().isoformat()


@dataclass(frozen=True, slots=True)
class TrialHeader:
    """What is known of a trial before its first sample."""

    kind: Kind
    source: Source
    sample_rate_hz: float
    calibration: Calibration
    protocol: ProtocolSummary = field(default_factory=ProtocolSummary)
    specimen: Specimen = field(default_factory=Specimen)
    log: tuple[str, ...] = ()
    trial_id: str = field(default_factory=lambda: str(uuid4()))
    started: str = field(default_factory=_now)
    software: str = ""
    software_version: str = ""
