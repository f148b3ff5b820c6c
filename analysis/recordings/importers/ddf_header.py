"""The header of a DMC recording (`.ddf`): lines found by their labels, and what is wrong with them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from analysis.errors import BadInputError
from analysis.recordings.trial import Calibration

UNITS = {"AI0": "mm", "AI1": "mN", "AO0": "mm", "AO1": "mN"}
_MEANING = {"AI0": "length", "AI1": "force", "AO0": "commanded length", "AO1": "commanded force"}
_ACTIONS = {
    *("Ramp", "Step", "Hold", "Stop", "Sine Wave", "Square Wave", "Triangle Wave", "Repeat", "Trigger"),
    *("Stimulus-Train", "Stimulus-Twitch", "Stimulus-Tetanus", "Stimulate", "Bath", "Data-Enable"),
    *("Data-Disable", "Larb File", "Pulse"),
}


@dataclass(frozen=True, slots=True)
class Step:
    """One row of the protocol array, as it stands, and the line of the file it stands in."""

    line: int
    wait_s: str
    action: str
    port: str
    parameters: str


@dataclass(frozen=True, slots=True)
class DdfHeader:
    """What stands before the samples.

    ``labelled`` holds the "label: value" lines, ``channels`` the rows of the calibration data by label and
    channel, ``columns`` the names over the samples, ``first_row`` the index of the line below them.
    """

    version: str
    labelled: dict[str, str]
    channels: dict[str, dict[str, str]]
    protocol: tuple[Step, ...]
    columns: tuple[str, ...]
    first_row: int


def read_header(path: Path, lines: list[str]) -> DdfHeader:
    """Find the header's lines by their labels, in whatever order. BadInputError where it is none."""
    version = lines[0].strip() if lines else ""
    if not (version.startswith("DMC") and "Data File" in version):
        raise BadInputError(
            f"{path}: line 1: is {version[:40]!r}, not 'DMCv5.3 Data File': "
            "this is no DMC recording, export it with DMC"
        )
    first = next((i for i, line in enumerate(lines) if _cells(line)[:2] == ["Sample", "AI0"]), None)
    if first is None:
        raise BadInputError(
            f"{path}: lacks the line 'Sample AI0 ...' that heads the data: it was cut short, copy it again"
        )
    labelled: dict[str, str] = {}
    channels: dict[str, dict[str, str]] = {}
    rows: dict[str, list[str]] = {}
    protocol: list[Step] = []
    in_protocol = False
    for number, line in enumerate(lines[:first], start=1):
        cells = _cells(line)
        label = cells[0] if cells else ""
        if label.startswith("Protocol Array"):
            in_protocol = True
        elif label.startswith("Test Data"):
            in_protocol = False
        elif in_protocol and len(cells) >= 2:
            padded = [*cells, "", "", ""]
            protocol.append(Step(number, padded[0], padded[1], padded[2], padded[3]))
        elif len(cells) >= 2:
            rows[label] = cells[1:]
        elif ":" in label:
            name, _, value = label.partition(":")
            labelled[name.strip()] = value.strip()
    names = rows.get("Channel", [])
    for label, values in rows.items():
        if label != "Channel":
            channels[label.partition("(")[0].strip()] = dict(zip(names, values, strict=False))
    return DdfHeader(version, labelled, channels, tuple(protocol), tuple(_cells(lines[first])), first + 1)


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.split("\t")] if line.strip() else []


def sample_rate(header: DdfHeader) -> tuple[float, list[str]]:
    """Return the sample rate, Hz, and what is wrong with it."""
    text = next((v for k, v in header.labelled.items() if k.startswith("Sample Frequency")), None)
    if text is None:
        return 0.0, ["lacks the line 'Sample Frequency (Hz):'"]
    rate = number_in(text)
    if rate is None or rate <= 0:
        return 0.0, [f"Sample Frequency is {text!r}, not a number above zero"]
    return rate, []


def _used(header: DdfHeader) -> list[str]:
    """The channels that are read; a recording without commands is one all the same."""
    return [channel for channel in UNITS if channel in header.columns or channel.startswith("AI")]


def unit_problems(header: DdfHeader) -> list[str]:
    """Say which channels are not in mm and mN; others are not converted, as a guess would be."""
    missing = [label for label in ("Units", "Scale", "Offset") if label not in header.channels]
    if missing:
        return [f"lacks the line '{label}' of the calibration data" for label in missing]
    units = header.channels["Units"]
    return [
        f"{_MEANING[channel]} ({channel}) is in {units.get(channel, '')!r}, not in {UNITS[channel]}"
        for channel in _used(header)
        if units.get(channel) != UNITS[channel]
    ]


def constant_problems(header: DdfHeader) -> list[str]:
    """Say which scales and offsets can't be used."""
    scales, offsets = header.channels.get("Scale", {}), header.channels.get("Offset", {})
    bad_scales = [channel for channel in _used(header) if not number_in(scales.get(channel, ""))]
    bad_offsets = [channel for channel in _used(header) if number_in(offsets.get(channel, "")) is None]
    problems = []
    if bad_scales:
        problems.append(f"scale of {', '.join(bad_scales)} is 0 or no number")
    if bad_offsets:
        problems.append(f"offset of {', '.join(bad_offsets)} is no number")
    return problems


def unknown_actions(header: DdfHeader) -> list[Step]:
    """Return the protocol's steps that this program has never met; they are reported, never executed."""
    return [step for step in header.protocol if step.action not in _ACTIONS]


def constants_of(header: DdfHeader, channel: str) -> tuple[float, float]:
    """Return zero, V, and scale, units/V, of a channel that was checked."""
    return float(header.channels["Offset"][channel]), float(header.channels["Scale"][channel])


def calibration_of(header: DdfHeader) -> Calibration:
    """Return the file's own constants, units = (volts - offset) x scale."""
    position_zero_v, mm_per_v = constants_of(header, "AI0")
    force_zero_v, mn_per_v = constants_of(header, "AI1")
    command_zero_v, command_mm_per_v = constants_of(header, "AO0") if "AO0" in header.columns else (0.0, 1.0)
    return Calibration(
        volts_per_mm=1 / mm_per_v,
        position_zero_v=position_zero_v,
        volts_per_mn=1 / mn_per_v,
        force_zero_v=force_zero_v,
        command_volts_per_mm=1 / command_mm_per_v,
        command_zero_v=command_zero_v,
    )


def header_log(header: DdfHeader) -> list[str]:
    """Return the lines of the log: which channel is what, and what was assumed."""
    lines = [f"{header.version}: AI0 is position, AI1 force, AO0 commanded position, AO1 commanded force"]
    constants = {channel: constants_of(header, channel) for channel in UNITS if channel in header.columns}
    scales = ", ".join(f"{c} {scale:g} {UNITS[c]}/V" for c, (_, scale) in constants.items())
    lines.append(f"volts to units by the file's own scales: {scales}")
    offsets = {channel: zero for channel, (zero, _) in constants.items() if zero}
    if offsets:
        shown = ", ".join(f"{c} {zero:g} V" for c, zero in offsets.items())
        lines.append(
            f"offsets ({shown}): taken as units = (volts - offset) x scale; readers of this format disagree "
            "on the sign, so that absolute position and force may be off by a constant, twice the offset"
        )
    else:
        lines.append(
            "offsets are 0, so that the sign of the offset, which readers disagree on, does not matter"
        )
    lines.append("signs: length out is taken as into the specimen, positive force as compression")
    lines += [f"protocol action {s.action!r} (line {s.line}) is unknown" for s in unknown_actions(header)]
    spare = [c for c in header.columns[1:] if c not in UNITS]
    if spare:
        lines.append(f"channels left out: {', '.join(spare)}")
    return lines


def protocol_toml(header: DdfHeader) -> str:
    """Return the header's labelled lines and its protocol array as TOML."""
    import tomlkit

    steps = [
        {
            "wait_s": step.wait_s if (wait := number_in(step.wait_s)) is None else wait,
            "action": step.action,
            "port": step.port,
            "parameters": step.parameters,
        }
        for step in header.protocol
    ]
    stated = {name: value for name, value in header.labelled.items() if value}
    return tomlkit.dumps({"format": header.version, "stated": stated, "protocol_array": steps})


def number_in(text: str) -> float | None:
    """Return the finite number that a text stands for, or None."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None
