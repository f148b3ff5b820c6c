"""The one table of the trial file: every attribute with its group, type, unit, check and default.

The reader and the writer both walk this table, so that neither can know of an attribute that the
other does not. Attributes of a group carry the names of the fields of the dataclass that holds them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import get_args

from analysis.recordings.checks import Check, filled, finite, moment, not_negative, one_of, positive, slope
from analysis.recordings.trial import FINGERS, Kind, Source, Status

FORMAT = "indenter-trial"
FORMAT_VERSION = 1

Value = str | float | int | None
RUNNING_SURFACE = "running/surface"
"""Where a running file says where the skin was found: position_mm, sample, overshoot_um, threshold_mn, or NaN."""

SIGNALS = ("position_v", "force_v", "command_v")
NATIVE_SIGNALS = ("time_s", "position_mm", "force_mn")


@dataclass(frozen=True, slots=True)
class Attribute:
    """One attribute of the trial file: where it stands, what it may be, what holds without it."""

    group: str
    name: str
    type: type[str] | type[float] | type[int]
    unit: str
    meaning: str
    check: Check | None = None
    required: bool = False
    default: Value = None

    @property
    def where(self) -> str:
        """The attribute's address in the file, as error messages give it."""
        return f"{self.group.rstrip('/')}/{self.name}"


_CONSTANTS = (
    ("volts_per_mm", "V/mm", slope, "slope of the recorded position"),
    ("position_zero_v", "V", finite, "recorded position at 0 mm"),
    ("volts_per_mn", "V/mN", slope, "slope of the recorded force"),
    ("force_zero_v", "V", finite, "recorded force at 0 mN"),
    ("command_volts_per_mm", "V/mm", slope, "slope of the commanded position"),
    ("command_zero_v", "V", finite, "commanded position at 0 mm"),
)

CONSTANT_NAMES = tuple(name for name, *_ in _CONSTANTS)

ATTRIBUTES: tuple[Attribute, ...] = (
    Attribute("/", "format", str, "", "what the file is", one_of([FORMAT]), required=True),
    Attribute(
        "/", "format_version", int, "", "version of the layout", one_of([FORMAT_VERSION]), required=True
    ),
    Attribute("/", "trial_id", str, "", "UUID of the trial", filled, required=True),
    Attribute("/", "started", str, "ISO 8601", "when the first sample was taken", moment, required=True),
    Attribute("/", "software", str, "", "program that made the file", default=""),
    Attribute("/", "software_version", str, "", "its version", default=""),
    Attribute("/", "status", str, "", "how the recording ended", one_of(get_args(Status)), required=True),
    Attribute("/", "status_reason", str, "", "why it ended so, empty when complete", default=""),
    Attribute("/", "kind", str, "", "what was done", one_of(get_args(Kind)), required=True),
    Attribute("/", "source", str, "", "where the samples come from", one_of(get_args(Source)), required=True),
    Attribute("/", "discarded", str, "", "why the operator discarded the trial", default=""),
    Attribute("/signals", "sample_rate_hz", float, "Hz", "samples a second", positive, required=True),
    *(
        # without a commanded position its constants are not needed
        Attribute(
            "/calibration",
            name,
            float,
            unit,
            meaning,
            check,
            required=not name.startswith("command"),
            default=1.0 if name.endswith("volts_per_mm") else 0.0,
        )
        for name, unit, check, meaning in _CONSTANTS
    ),
    *(
        Attribute("/calibration", f"{name}_se", float, unit, f"standard error of {name}", not_negative)
        for name, unit, _, _ in _CONSTANTS
    ),
    Attribute("/calibration", "calibrated", str, "ISO 8601", "when it was calibrated", default=""),
    Attribute(
        "/surface", "position_mm", float, "mm", "detected contact, lever coordinates", finite, required=True
    ),
    Attribute("/surface", "sample", int, "samples", "sample of the detection", default=-1),
    Attribute("/surface", "overshoot_um", float, "um", "travel beyond it", finite, default=math.nan),
    Attribute(
        "/surface", "threshold_mn", float, "mN", "force that counted as contact", finite, default=math.nan
    ),
    Attribute("/protocol", "depth_mm", float, "mm", "indentation depth", not_negative),
    Attribute("/protocol", "ramp_speed_mm_s", float, "mm/s", "speed of the ramp", not_negative),
    Attribute("/protocol", "hold_s", float, "s", "length of the hold", not_negative),
    Attribute("/protocol", "dwell_s", float, "s", "rest at the surface before the ramp", not_negative),
    Attribute("/protocol", "approach_speed_mm_s", float, "mm/s", "speed of the approach", not_negative),
    Attribute("/protocol", "retract_speed_mm_s", float, "mm/s", "speed of the retract", not_negative),
    Attribute("/protocol", "contact_threshold_mn", float, "mN", "force that counts as contact", finite),
    Attribute("/specimen", "subject", str, "", "whose finger", default=""),
    Attribute("/specimen", "finger", str, "", "which finger", one_of((*FINGERS, "")), default=""),
    Attribute("/specimen", "site", str, "", "where on the finger", default=""),
    Attribute("/specimen", "repeat", int, "", "number of the repeat"),
    Attribute("/specimen", "punch_diameter_mm", float, "mm", "diameter of the punch", positive),
    Attribute("/specimen", "rest_s", float, "s", "time since the previous indentation ended", not_negative),
    Attribute("/specimen", "notes", str, "", "free text", default=""),
    Attribute("/specimen", "target_stiffness_mn_per_mm", float, "mN/mm", "stiffness of a block", positive),
)


@cache
def attributes_of(group: str) -> tuple[Attribute, ...]:
    """Return the declared attributes of a group, in the order of the table."""
    return tuple(attribute for attribute in ATTRIBUTES if attribute.group == group)
