"""The trial in memory: what a trial file says, as immutable data in SI-like bench units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Kind = Literal[
    "ramp_hold_retract",
    "air_sweep",
    "rigid_target",
    "surface_detection",
    "position_calibration",
    "force_calibration",
]
Status = Literal["running", "complete", "aborted", "recovered"]
Source = Literal["nidaqmx", "simulated", "imported"]
FloatArray = NDArray[np.float64]

PHASE_NAMES = ("approach", "dwell", "ramp", "hold", "retract", "clear", "sweep")
FINGERS = ("thumb", "index", "middle", "ring", "little")


@dataclass(frozen=True, slots=True)
class Phase:
    """A named stretch of samples, ``stop`` exclusive."""

    name: str
    start: int
    stop: int

    @property
    def samples(self) -> slice:
        """The stretch as a slice into the signals."""
        return slice(self.start, self.stop)


@dataclass(frozen=True, slots=True)
class Calibration:
    """The constants that turn volts into millimetres and millinewtons.

    ``standard_errors`` maps a constant's name to its standard error, where it is known.
    """

    volts_per_mm: float
    position_zero_v: float
    volts_per_mn: float
    force_zero_v: float
    command_volts_per_mm: float
    command_zero_v: float
    calibrated: str = ""
    standard_errors: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Surface:
    """Where the skin was found, in lever coordinates."""

    position_mm: float
    sample: int
    overshoot_um: float
    threshold_mn: float


@dataclass(frozen=True, slots=True)
class ProtocolSummary:
    """The numbers of the protocol that analysis needs; None where the file does not say."""

    depth_mm: float | None = None
    ramp_speed_mm_s: float | None = None
    hold_s: float | None = None
    dwell_s: float | None = None
    approach_speed_mm_s: float | None = None
    retract_speed_mm_s: float | None = None
    contact_threshold_mn: float | None = None
    toml: str = ""


@dataclass(frozen=True, slots=True)
class Specimen:
    """Whose finger, where and how long after the previous indentation."""

    subject: str = ""
    finger: str = ""
    site: str = ""
    repeat: int | None = None
    punch_diameter_mm: float | None = None
    rest_s: float | None = None
    notes: str = ""
    target_stiffness_mn_per_mm: float | None = None


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened at a sample: a limit, an alignment, a prompt answered."""

    sample: int
    kind: str
    message: str


@dataclass(frozen=True, slots=True)
class NativeSamples:
    """The samples of an import as they were taken, where they are unevenly spaced.

    ``time_s`` rises strictly and counts from the first sample of the trial; all three are (M,).
    """

    time_s: FloatArray
    position_mm: FloatArray
    force_mn: FloatArray


@dataclass(frozen=True)
class Trial:
    """One recorded trial.

    Signals are 1-D arrays of equal length N in volts; ``position_mm``, ``force_mn`` and
    ``command_mm`` are the same in bench units (position positive into the skin, force positive in
    compression). ``command_v`` is None where an import had none. ``other_channels`` are channels of
    an import that have no place in the layout, by name and unit (``force_command_mn``), (N,) each.
    """

    trial_id: str
    started: str
    kind: Kind
    source: Source
    status: Status
    sample_rate_hz: float
    position_v: FloatArray
    force_v: FloatArray
    command_v: FloatArray | None
    calibration: Calibration
    phases: tuple[Phase, ...]
    status_reason: str = ""
    software: str = ""
    software_version: str = ""
    surface: Surface | None = None
    protocol: ProtocolSummary = ProtocolSummary()
    specimen: Specimen = Specimen()
    events: tuple[Event, ...] = ()
    log: tuple[str, ...] = ()
    discarded: str = ""
    path: str = ""
    native: NativeSamples | None = None
    other_channels: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def n_samples(self) -> int:
        """Number of samples N of every channel."""
        return len(self.position_v)

    @cached_property
    def time_s(self) -> FloatArray:
        """Time since the first sample, (N,), s."""
        return np.arange(self.n_samples) / self.sample_rate_hz

    @cached_property
    def position_mm(self) -> FloatArray:
        """Recorded lever position, (N,), mm, positive into the skin."""
        c = self.calibration
        return (self.position_v - c.position_zero_v) / c.volts_per_mm

    @cached_property
    def force_mn(self) -> FloatArray:
        """Recorded force, (N,), mN, positive in compression."""
        c = self.calibration
        return (self.force_v - c.force_zero_v) / c.volts_per_mn

    @cached_property
    def command_mm(self) -> FloatArray | None:
        """Commanded lever position, (N,), mm, or None where it was not recorded."""
        if self.command_v is None:
            return None
        c = self.calibration
        return (self.command_v - c.command_zero_v) / c.command_volts_per_mm

    def phase(self, name: str) -> Phase | None:
        """Return the first phase of that name, or None."""
        return next((p for p in self.phases if p.name == name), None)
