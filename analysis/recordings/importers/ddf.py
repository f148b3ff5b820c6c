"""Aurora Scientific's DMC recordings (`.ddf`, text): samples, and the phases that they show."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis.errors import BadInputError
from analysis.recordings.importers.ddf_header import (
    UNITS,
    DdfHeader,
    calibration_of,
    constant_problems,
    constants_of,
    header_log,
    number_in,
    protocol_toml,
    read_header,
    sample_rate,
    unit_problems,
    unknown_actions,
)
from analysis.recordings.importers.draft import Draft, one_phase, refuse_dead_signals
from analysis.recordings.importers.dual_mode import find_modes
from analysis.recordings.motion import phases_from_motion
from analysis.recordings.trial import FloatArray, Kind, ProtocolSummary

_MOST_REASONS = 4


def read_ddf(path: Path, kind: Kind) -> Draft:
    """Read a DMC recording: AI0 length, AI1 force, AO0 and AO1 their commands, volts to mm and mN.

    Raises BadInputError with every reason found where the file can't be used.
    """
    lines = _lines(path)
    header = read_header(path, lines)
    rate, problems = sample_rate(header)
    problems += unit_problems(header)
    volts, row_problems = _rows(header, lines)
    problems += row_problems + constant_problems(header)
    if problems:
        unknown = [f"line {s.line}: protocol action {s.action!r} is unknown" for s in unknown_actions(header)]
        reasons = "; ".join((unknown + problems)[:_MOST_REASONS])
        raise BadInputError(f"{path}: {reasons}: record or export it again with DMC")
    refuse_dead_signals(path, volts["AI0"], volts["AI1"])
    volts, dropped = _without_empty_end(volts)
    calibration = calibration_of(header)
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
        protocol=ProtocolSummary(toml=protocol_toml(header)),
        log=(*header_log(header), *dropped),
    )
    force_command_mn = None
    if "AO1" in volts:
        zero, scale = constants_of(header, "AO1")
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


def _lines(path: Path) -> list[str]:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadInputError(f"{path}: can't be read ({error.strerror}): check the disk") from error
    # DMC writes plain ASCII, comments may hold what the operator's Windows had
    return data.decode("cp1252", errors="replace").splitlines()


def _rows(header: DdfHeader, lines: list[str]) -> tuple[dict[str, FloatArray], list[str]]:
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
    wanted = [name for name in UNITS if name in header.columns]
    missing = [name for name in ("AI0", "AI1") if name not in wanted]
    problem = f"lacks the column {', '.join(missing)}" if missing else _slipped(table[:, 0])
    if problem:
        return {}, [problem]
    return {name: np.ascontiguousarray(table[:, header.columns.index(name)]) for name in wanted}, []


def _slipped(counted: FloatArray) -> str:
    """Return what is wrong with the Sample column, which counts by one; the time of a sample rests on it."""
    wrong = np.flatnonzero(np.diff(counted) != 1)
    if not wrong.size:
        return ""
    before, after = counted[wrong[0]], counted[wrong[0] + 1]
    what = "missing" if after > before else "doubled or out of order"
    return f"Sample is {after:g} after {before:g} ({wrong.size} such place(s)): samples are {what}"


def _bad_cell(header: DdfHeader, number: int, cells: list[str]) -> str:
    for name, cell in zip(header.columns, cells, strict=False):
        value = number_in(cell)
        if value is None:
            return f"line {number}: {name} is {cell.strip()[:20]!r}, not a number"
    return f"line {number}: can't be read"


def _without_empty_end(volts: dict[str, FloatArray]) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """Leave away rows at the end that are zero in position and force: the recorder never filled them."""
    measured = np.flatnonzero((volts["AI0"] != 0) | (volts["AI1"] != 0))
    n = int(measured[-1]) + 1
    empty = len(volts["AI0"]) - n
    if not empty:
        return volts, ()
    kept = {name: values[:n] for name, values in volts.items()}
    return kept, (f"the last {empty} sample(s), zero in position and force, were left away",)
