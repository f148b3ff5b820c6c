"""From columns of time, position and force to a draft: an even grid where there is none, and the phases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis.errors import BadInputError
from analysis.recordings.importers.draft import Draft, even_grid, even_rate_hz, one_phase, refuse_dead_signals
from analysis.recordings.importers.held_force import without_held_force
from analysis.recordings.motion import phases_from_motion
from analysis.recordings.trial import FloatArray, Kind, NativeSamples

NEEDED = ("time_s", "position_mm", "force_mn")
OPTIONAL = ("command_mm",)
_FEWEST_ROWS = 8
_GAP = 1.5  # intervals beyond which samples are missing


def draft_of_columns(
    path: Path, columns: Mapping[str, FloatArray], lines: Sequence[int], kind: Kind, log: Sequence[str]
) -> Draft:
    """Return the draft of columns named as `NEEDED` and `OPTIONAL`, (N,) each, read from ``lines`` (N,).

    Unevenly spaced samples are interpolated onto an even grid and kept beside it as they were. Raises
    BadInputError that names the line where time does not rise, or where nothing was recorded.
    """
    time_s, position_mm, force_mn = (columns[name] for name in NEEDED)
    _check_time(path, time_s, lines)
    refuse_dead_signals(path, position_mm, force_mn)
    draft = _evenly_sampled(columns, list(log))
    fixed = one_phase(kind, len(draft.position_v))
    if fixed is not None:
        phases, line = fixed
        return replace(draft, phases=phases, log=(*draft.log, line))
    phases = phases_from_motion(draft.position_v, draft.sample_rate_hz)
    found = ", ".join(phase.name for phase in phases)
    line = f"phases found from the motion: {found or 'none, the motion shows no press and hold'}"
    return without_held_force(replace(draft, phases=phases, log=(*draft.log, line)))


def _evenly_sampled(columns: Mapping[str, FloatArray], log: list[str]) -> Draft:
    time_s, position_mm, force_mn = (columns[name] for name in NEEDED)
    command_mm = columns.get("command_mm")
    if time_s[0] != 0:
        log.append(f"time counts from the first sample; it was {time_s[0]:g} s in the file")
    elapsed_s = time_s - time_s[0]
    rate = even_rate_hz(elapsed_s)
    if rate is not None:
        log.append(f"evenly sampled: {len(time_s)} samples at {rate:g} Hz")
        return Draft(rate, position_mm, force_mn, command_mm, (), tuple(log))
    grid, rate = even_grid(elapsed_s)
    log.append(
        f"unevenly sampled: {len(time_s)} samples interpolated linearly onto {len(grid)} at {rate:g} Hz; "
        "the samples as they were taken are kept in /import"
    )
    log.extend(gaps(elapsed_s))
    return Draft(
        sample_rate_hz=rate,
        position_v=np.interp(grid, elapsed_s, position_mm),
        force_v=np.interp(grid, elapsed_s, force_mn),
        command_v=None if command_mm is None else np.interp(grid, elapsed_s, command_mm),
        phases=(),
        log=tuple(log),
        native=NativeSamples(elapsed_s, position_mm, force_mn),
    )


def gaps(elapsed_s: FloatArray) -> list[str]:
    """Return a line on samples missing from an otherwise even recording, none where it is uneven throughout."""
    steps_s = np.diff(elapsed_s)
    usual_s = float(np.median(steps_s))
    wide = np.flatnonzero(steps_s > _GAP * usual_s)
    uneven = np.abs(np.delete(steps_s, wide) - usual_s) > 0.1 * usual_s
    if not wide.size or wide.size > len(steps_s) // 10 or uneven.mean() > 0.1:
        return []
    missing = int(np.sum(np.round(steps_s[wide] / usual_s) - 1))
    longest = int(wide[np.argmax(steps_s[wide])])
    return [
        f"samples missing: {missing} in {wide.size} place(s), the longest gap of {steps_s[longest]:.4g} s "
        f"at {elapsed_s[longest]:.4g} s"
    ]


def _check_time(path: Path, time_s: FloatArray, lines: Sequence[int]) -> None:
    if len(time_s) < _FEWEST_ROWS:
        raise BadInputError(
            f"{path}: has {len(time_s)} rows of samples: a recording needs {_FEWEST_ROWS} or more"
        )
    back = np.flatnonzero(np.diff(time_s) <= 0)
    if back.size:
        i = int(back[0])
        raise BadInputError(
            f"{path}: line {lines[i + 1]}: time_s is {time_s[i + 1]:g} after {time_s[i]:g}: "
            "it must rise from row to row, with enough digits"
        )
