"""Aurora Scientific's DMC recordings (`.ddf`, text): header lines are found by their labels."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analysis.errors import BadInputError
from analysis.recordings.draft import Draft, one_phase, refuse_dead_signals
from analysis.recordings.dual_mode import find_modes
from analysis.recordings.motion import phases_from_motion
from analysis.recordings.trial import Calibration, FloatArray, Kind, ProtocolSummary

_UNITS = {"AI0": "mm", "AI1": "mN", "AO0": "mm", "AO1": "mN"}
_MEANING = {"AI0": "length", "AI1": "force", "AO0": "commanded length", "AO1": "commanded force"}
_ACTIONS = {
    *("Ramp", "Step", "Hold", "Stop", "Sine Wave", "Square Wave", "Triangle Wave", "Repeat", "Trigger"),
    *("Stimulus-Train", "Stimulus-Twitch", "Stimulus-Tetanus", "Stimulate", "Bath", "Data-Enable"),
    *("Data-Disable", "Larb File", "Pulse"),
}
_MOST_REASONS = 4


@dataclass(frozen=True, slots=True)
class _Step:
    line: int
    wait_s: str
    action: str
    port: str
    parameters: str


@dataclass(frozen=True, slots=True)
class _Header:
    version: str
    labelled: dict[str, str]
    channels: dict[str, dict[str, str]]
    protocol: tuple[_Step, ...]
    columns: tuple[str, ...]
    first_row: int


def read_ddf(path: Path, kind: Kind) -> Draft:
    """Read a DMC recording: AI0 length, AI1 force, AO0 and AO1 their commands, volts to mm and mN.

    Raises BadInputError with every reason found where the file can't be used.
    """
    lines = _lines(path)
    header = _header(path, lines)
    rate, problems = _rate(header)
    problems += _unit_problems(header)
    volts, row_problems = _rows(header, lines)
    problems += row_problems + _constant_problems(header)
    if problems:
        unknown = [
            f"line {s.line}: protocol action {s.action!r} is unknown" for s in _unknown_actions(header)
        ]
        reasons = "; ".join((unknown + problems)[:_MOST_REASONS])
        raise BadInputError(f"{path}: {reasons}: record or export it again with DMC")
    refuse_dead_signals(path, volts["AI0"], volts["AI1"])
    volts, dropped = _without_empty_end(volts)
    calibration = _calibration(header)
    position_mm = (volts["AI0"] - calibration.position_zero_v) / calibration.volts_per_mm
    force_mn = (volts["AI1"] - calibration.force_zero_v) / calibration.volts_per_mn
    command_v = volts.get("AO0")
    draft = Draft(
        sample_rate_hz=rate,
        position_v=volts["AI0"],
        force_v=volts["AI1"],
        command_v=command_v,
        phases=(),
        calibration=calibration,
        protocol=ProtocolSummary(toml=_protocol_toml(header)),
        log=(*_log(header), *dropped),
    )
    force_command_mn = None
    if "AO1" in volts:
        zero, scale = _constants(header, "AO1")
        force_command_mn = (volts["AO1"] - zero) * scale
        draft = replace(draft, other_channels={"force_command_mn": force_command_mn})
    fixed = one_phase(kind, len(position_mm))
    if fixed is not None:
        phases, words = fixed
        return replace(draft, phases=phases, log=(*draft.log, words))
    return _with_phases(draft, position_mm, force_mn, force_command_mn)


def _with_phases(
    draft: Draft, position_mm: FloatArray, force_mn: FloatArray, force_command_mn: FloatArray | None
) -> Draft:
    """Add the phases: of a lever that holds force or length in turn, or of a lever that only moves."""
    if draft.command_v is not None and force_command_mn is not None and np.ptp(force_command_mn) > 0:
        c = draft.calibration
        command_mm = (draft.command_v - c.command_zero_v) / c.command_volts_per_mm
        modes = find_modes(position_mm, force_mn, command_mm, force_command_mn, draft.sample_rate_hz)
        protocol = replace(draft.protocol, depth_mm=modes.depth_mm, hold_s=modes.hold_s)
        return replace(
            draft,
            phases=modes.phases,
            events=modes.events,
            surface=modes.surface,
            protocol=protocol,
            log=(*draft.log, *modes.log),
        )
    if draft.command_v is not None and np.ptp(draft.command_v) == 0:
        words = "phases: none, neither length nor force is commanded to move: nothing is pressed"
        return replace(draft, log=(*draft.log, words))
    phases = phases_from_motion(position_mm, draft.sample_rate_hz)
    found = ", ".join(phase.name for phase in phases)
    words = f"phases found from the motion: {found or 'none, the motion shows no press and hold'}"
    return replace(draft, phases=phases, log=(*draft.log, words))


# the header


def _lines(path: Path) -> list[str]:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadInputError(f"{path}: can't be read ({error.strerror}): check the disk") from error
    # DMC writes plain ASCII, comments may hold what the operator's Windows had
    return data.decode("cp1252", errors="replace").splitlines()


def _header(path: Path, lines: list[str]) -> _Header:
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
    protocol: list[_Step] = []
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
            protocol.append(_Step(number, padded[0], padded[1], padded[2], padded[3]))
        elif len(cells) >= 2:
            rows[label] = cells[1:]
        elif ":" in label:
            name, _, value = label.partition(":")
            labelled[name.strip()] = value.strip()
    names = rows.get("Channel", [])
    for label, values in rows.items():
        if label != "Channel":
            channels[label.partition("(")[0].strip()] = dict(zip(names, values, strict=False))
    return _Header(version, labelled, channels, tuple(protocol), tuple(_cells(lines[first])), first + 1)


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.split("\t")] if line.strip() else []


def _rate(header: _Header) -> tuple[float, list[str]]:
    text = next((v for k, v in header.labelled.items() if k.startswith("Sample Frequency")), None)
    if text is None:
        return 0.0, ["lacks the line 'Sample Frequency (Hz):'"]
    rate = _float(text)
    if rate is None or rate <= 0:
        return 0.0, [f"Sample Frequency is {text!r}, not a number above zero"]
    return rate, []


def _used(header: _Header) -> list[str]:
    """The channels that are read; a recording without commands is one all the same."""
    return [channel for channel in _UNITS if channel in header.columns or channel.startswith("AI")]


def _unit_problems(header: _Header) -> list[str]:
    missing = [label for label in ("Units", "Scale", "Offset") if label not in header.channels]
    if missing:
        return [f"lacks the line '{label}' of the calibration data" for label in missing]
    units = header.channels["Units"]
    return [
        f"{_MEANING[channel]} ({channel}) is in {units.get(channel, '')!r}, not in {_UNITS[channel]}"
        for channel in _used(header)
        if units.get(channel) != _UNITS[channel]
    ]


def _constant_problems(header: _Header) -> list[str]:
    scales = {channel: _float(header.channels.get("Scale", {}).get(channel, "")) for channel in _used(header)}
    offsets = {
        channel: _float(header.channels.get("Offset", {}).get(channel, "")) for channel in _used(header)
    }
    bad_scales = [channel for channel, scale in scales.items() if not scale]
    bad_offsets = [channel for channel, offset in offsets.items() if offset is None]
    problems = []
    if bad_scales:
        problems.append(f"scale of {', '.join(bad_scales)} is 0 or no number")
    if bad_offsets:
        problems.append(f"offset of {', '.join(bad_offsets)} is no number")
    return problems


def _unknown_actions(header: _Header) -> list[_Step]:
    return [step for step in header.protocol if step.action not in _ACTIONS]


def _constants(header: _Header, channel: str) -> tuple[float, float]:
    """Return zero, V, and scale, units/V, of a channel that was checked."""
    return float(header.channels["Offset"][channel]), float(header.channels["Scale"][channel])


def _calibration(header: _Header) -> Calibration:
    position_zero_v, mm_per_v = _constants(header, "AI0")
    force_zero_v, mn_per_v = _constants(header, "AI1")
    command_zero_v, command_mm_per_v = _constants(header, "AO0") if "AO0" in header.columns else (0.0, 1.0)
    return Calibration(
        volts_per_mm=1 / mm_per_v,
        position_zero_v=position_zero_v,
        volts_per_mn=1 / mn_per_v,
        force_zero_v=force_zero_v,
        command_volts_per_mm=1 / command_mm_per_v,
        command_zero_v=command_zero_v,
    )


def _log(header: _Header) -> list[str]:
    lines = [f"{header.version}: AI0 is position, AI1 force, AO0 commanded position, AO1 commanded force"]
    constants = {channel: _constants(header, channel) for channel in _UNITS if channel in header.columns}
    scales = ", ".join(f"{c} {scale:g} {_UNITS[c]}/V" for c, (_, scale) in constants.items())
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
    lines += [f"protocol action {s.action!r} (line {s.line}) is unknown" for s in _unknown_actions(header)]
    spare = [c for c in header.columns[1:] if c not in _UNITS]
    if spare:
        lines.append(f"channels left out: {', '.join(spare)}")
    return lines


def _protocol_toml(header: _Header) -> str:
    """The protocol array as TOML; JSON's strings are TOML's basic strings."""
    lines = [f"format = {json.dumps(header.version)}"]
    lines += [f"{json.dumps(name)} = {json.dumps(value)}" for name, value in header.labelled.items() if value]
    for step in header.protocol:
        wait = _float(step.wait_s)
        lines += [
            "",
            "[[protocol_array]]",
            f"wait_s = {json.dumps(step.wait_s) if wait is None else wait!r}",
            f"action = {json.dumps(step.action)}",
            f"port = {json.dumps(step.port)}",
            f"parameters = {json.dumps(step.parameters)}",
        ]
    return "\n".join(lines) + "\n"


# the samples


def _rows(header: _Header, lines: list[str]) -> tuple[dict[str, FloatArray], list[str]]:
    """Return the channels in volts, (N,), or what is wrong with the first bad row."""
    values: list[list[float]] = []
    width = len(header.columns)
    for number, line in enumerate(lines[header.first_row :], start=header.first_row + 1):
        if not line.strip():
            continue
        cells = line.split("\t")
        if len(cells) < width:
            return {}, [f"line {number}: has {len(cells)} values for {width} columns"]
        try:
            row = [float(cell) for cell in cells[:width]]
        except ValueError:
            return {}, [_bad_cell(header, number, cells)]
        if not all(map(math.isfinite, row)):
            return {}, [_bad_cell(header, number, cells)]
        values.append(row)
    if len(values) < 8:
        return {}, [f"holds {len(values)} sample{'s' * (len(values) != 1)}, too few for a recording"]
    table = np.array(values)
    wanted = [name for name in _UNITS if name in header.columns]
    missing = [name for name in ("AI0", "AI1") if name not in wanted]
    if missing:
        return {}, [f"lacks the column {', '.join(missing)}"]
    return {name: np.ascontiguousarray(table[:, header.columns.index(name)]) for name in wanted}, []


def _bad_cell(header: _Header, number: int, cells: list[str]) -> str:
    for name, cell in zip(header.columns, cells, strict=False):
        value = _float(cell)
        if value is None:
            return f"line {number}: {name} is {cell.strip()[:20]!r}, not a number"
    return f"line {number}: can't be read"


def _float(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _without_empty_end(volts: dict[str, FloatArray]) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """Leave away rows at the end that are zero in position and force: the recorder never filled them."""
    measured = np.flatnonzero((volts["AI0"] != 0) | (volts["AI1"] != 0))
    n = int(measured[-1]) + 1
    empty = len(volts["AI0"]) - n
    if not empty:
        return volts, ()
    kept = {name: values[:n] for name, values in volts.items()}
    return kept, (f"the last {empty} sample(s), zero in position and force, were left away",)
