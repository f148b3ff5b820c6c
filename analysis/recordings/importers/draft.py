"""A recording on its way to a trial file: what an importer has read, and the steps common to all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from uuid import uuid4

import numpy as np

from analysis.errors import BadInputError
from analysis.recordings.trial import (
    Calibration,
    Event,
    FloatArray,
    Kind,
    NativeSamples,
    Phase,
    ProtocolSummary,
    Specimen,
    Surface,
    Trial,
)
from analysis.recordings.writing import SOFTWARE, software_version

_EVEN = 0.05  # share of the sample interval by which a time stamp may miss an even grid
_MOST_SAMPLES = 2_000_000

UNIT_VOLTS = Calibration(1.0, 0.0, 1.0, 0.0, 1.0, 0.0)
"""Constants for recordings that came in units: one volt is one millimetre and one millinewton."""


@dataclass(frozen=True, slots=True)
class Draft:
    """What an importer has made of one recording; signals in volts, (N,), evenly sampled."""

    sample_rate_hz: float
    position_v: FloatArray
    force_v: FloatArray
    command_v: FloatArray | None
    phases: tuple[Phase, ...]
    log: tuple[str, ...]
    calibration: Calibration = UNIT_VOLTS
    surface: Surface | None = None
    protocol: ProtocolSummary = field(default_factory=ProtocolSummary)
    events: tuple[Event, ...] = ()
    native: NativeSamples | None = None
    other_channels: Mapping[str, FloatArray] = field(default_factory=dict)
    started: str = ""
    name: str = ""


def trial_of(draft: Draft, source: Path, kind: Kind) -> Trial:
    """Return the trial of a draft, with where it came from at the head of its log."""
    now = datetime.now().astimezone().isoformat(timespec="seconds")
    notes = "" if draft.started else "the time of recording is not stated; started is the time of the import"
    return Trial(
        trial_id=str(uuid4()),
        started=draft.started or now,
        kind=kind,
        source="imported",
        status="complete",
        sample_rate_hz=draft.sample_rate_hz,
        position_v=draft.position_v,
        force_v=draft.force_v,
        command_v=draft.command_v,
        calibration=draft.calibration,
        phases=draft.phases,
        software=SOFTWARE,
        software_version=software_version(),
        surface=draft.surface,
        protocol=draft.protocol,
        specimen=Specimen(),
        events=draft.events,
        log=tuple(filter(None, (f"{now}: imported from {source.name}", notes, *draft.log))),
        native=draft.native,
        other_channels=draft.other_channels,
    )


def one_phase(kind: Kind, n_samples: int) -> tuple[tuple[Phase, ...], str] | None:
    """Return the phases and log line of a kind whose phases do not depend on the motion, else None."""
    if kind == "air_sweep":
        return (Phase("sweep", 0, n_samples),), "phases: one sweep over the whole recording, as its kind says"
    if kind in {"surface_detection", "position_calibration", "force_calibration"}:
        return (), f"phases: none, as the kind {kind} has none that the recording shows"
    return None


def refuse_dead_signals(path: Path, position: FloatArray, force: FloatArray) -> None:
    """Raise BadInputError where the recorder wrote zeros: a valid file over data that were never taken."""
    if not position.any() and not force.any():
        raise BadInputError(
            f"{path}: position and force are zero throughout: nothing was recorded, leave it out"
        )
    if not force.any():
        raise BadInputError(f"{path}: force is zero throughout: the sensor was not recorded, leave it out")


def even_rate_hz(time_s: FloatArray) -> float | None:
    """Return the sample rate of time stamps (N,) that lie on an even grid, else None."""
    n = len(time_s)
    interval = (time_s[-1] - time_s[0]) / (n - 1)
    grid = time_s[0] + interval * np.arange(n)
    if np.abs(time_s - grid).max() > _EVEN * interval:
        return None
    rate = 1 / interval
    # time stamps are written with few digits: 999.976 Hz is 1000 Hz if that misses no stamp either
    rounded = float(np.round(rate, -1)) if rate >= 100 else float(np.round(rate, 2))
    if rounded > 0 and np.abs(time_s - time_s[0] - np.arange(n) / rounded).max() <= _EVEN * interval:
        return rounded
    return float(rate)


def even_grid(time_s: FloatArray) -> tuple[FloatArray, float]:
    """Return an even grid over rising time stamps, s, and its rate, Hz: as fine as the finest stretch."""
    steps = np.diff(time_s)
    finest = float(np.percentile(steps, 2, method="lower"))
    duration = float(time_s[-1] - time_s[0])
    rate = min(1 / finest, _MOST_SAMPLES / duration)
    grid = time_s[0] + np.arange(int(np.floor(duration * rate + 1e-6)) + 1) / rate
    return grid, rate
