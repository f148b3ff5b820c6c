"""AFM force curves with a pause (stress relaxation), read through the afmformats package."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterable
from dataclasses import replace
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.errors import BadInputError
from analysis.recordings.importers.draft import Draft, even_grid, even_rate_hz, one_phase, refuse_dead_signals
from analysis.recordings.importers.held_force import without_held_force
from analysis.recordings.trial import FloatArray, Kind, NativeSamples, Phase, ProtocolSummary

_HEIGHTS = ("height (measured)", "height (piezo)")


def read_afm(path: Path, kind: Kind) -> list[Draft]:
    """Read the curves of an AFM file: force and measured height over time, phases from its segments.

    Forces stay in mN and heights in mm, however small (1 nN is 1e-6 mN). Raises BadInputError where the
    package is missing or the file holds no curve over time.
    """
    try:
        import afmformats
        from afmformats.errors import AFMFileFormatError, MissingMetaDataError
    except ImportError as error:
        raise BadInputError(
            f"{path}: AFM files need the package afmformats: pip install indenter[afm]"
        ) from error
    endings = sorted(set(afmformats.formats.supported_extensions) - {".csv", ".ddf"})
    if path.suffix.lower() not in endings:
        raise BadInputError(
            f"{path}: files ending in {path.suffix or 'nothing'} are not known: "
            f"import takes .ddf, .csv, {', '.join(endings)}"
        )
    own_errors = (Exception, AFMFileFormatError, MissingMetaDataError)  # the last two are BaseExceptions
    drafts = [_draft(path, curve, kind) for curve in _curves(path, afmformats.load_data, own_errors)]
    if not drafts:
        raise BadInputError(f"{path}: holds no force curve: check the export")
    if len(drafts) == 1:
        return drafts
    return [replace(draft, name=f"{path.stem}-{number:04d}") for number, draft in enumerate(drafts)]


def _curves(
    path: Path, load: Callable[[Path], Iterable[Any]], own_errors: tuple[type[BaseException], ...]
) -> list[Any]:
    """Load every curve, quietly: the package warns of metadata not used here, and logs tracebacks."""
    logger = logging.getLogger("afmformats")
    was_disabled, logger.disabled = logger.disabled, True
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return list(load(path))
    except own_errors as error:  # its parsers of a dozen formats raise what they meet
        reason = " ".join(f"{type(error).__name__} {error}".split())[:160]
        raise BadInputError(f"{path}: can't be read as an AFM file ({reason}): check the export") from error
    finally:
        logger.disabled = was_disabled


def _draft(path: Path, curve: Any, kind: Kind) -> Draft:
    height = next((name for name in _HEIGHTS if name in curve.columns), None)
    missing = [name for name in ("force", "time", "segment") if name not in curve.columns]
    if height is None or missing:
        lacking = ", ".join(missing) or " or ".join(_HEIGHTS)
        raise BadInputError(f"{path}: lacks {lacking}: export the curve with time, force and height")
    time_s, force_mn = _column(curve, "time"), 1e3 * _column(curve, "force")
    raw_mm = 1e3 * _column(curve, height)
    segment = np.asarray(curve["segment"]).astype(int)
    refuse_dead_signals(path, raw_mm, force_mn)
    for name, values in (("time", time_s), ("force", force_mn), (height, raw_mm)):
        if not np.isfinite(values).all():
            raise BadInputError(f"{path}: {name} holds values that are no numbers: export the curve again")
    if len(time_s) < 8 or (np.diff(time_s) <= 0).any():
        raise BadInputError(f"{path}: time does not rise from sample to sample: export the curve again")
    time_s = time_s - time_s[0]
    spans = _spans(segment)
    sign, line = _direction(raw_mm, force_mn)
    travel_mm = sign * (raw_mm - raw_mm[0])
    position_mm, bending = _tip(curve, travel_mm, force_mn)
    log = [
        f"force in mN (1 nN is 1e-6 mN), position from '{height}' in mm, counted from the first sample; "
        "volts stand for units: 1 V is 1 mm, 1 V is 1 mN",
        line,
        bending,
    ]
    grid, rate, native = time_s, even_rate_hz(time_s), None
    if rate is None:
        grid, rate = even_grid(time_s)
        native = NativeSamples(time_s, position_mm, force_mn)
        rates = ", ".join(f"{(b - a - 1) / (time_s[b - 1] - time_s[a]):.4g}" for a, b in spans if b - a > 1)
        log.append(
            f"segments sampled at {rates} Hz interpolated linearly onto {rate:g} Hz; the samples as they "
            "were taken are kept in /import"
        )
    fixed = one_phase(kind, len(grid))
    if fixed is not None:
        phases, words = fixed
    else:
        phases, words = _phases(spans, time_s, travel_mm, grid)
    started, when = _started(curve)
    hold = next((phase for phase in phases if phase.name == "hold"), None)
    draft = Draft(
        sample_rate_hz=rate,
        position_v=np.interp(grid, time_s, position_mm),
        force_v=np.interp(grid, time_s, force_mn),
        command_v=None,
        phases=phases,
        log=(*log, when, words) if when else (*log, words),
        started=started,
        native=native,
        protocol=ProtocolSummary(
            ramp_speed_mm_s=_speed(curve, "speed approach"),
            retract_speed_mm_s=_speed(curve, "speed retract"),
            hold_s=None if hold is None else (hold.stop - hold.start) / rate,
        ),
    )
    return without_held_force(draft)


def _tip(curve: Any, travel_mm: FloatArray, force_mn: FloatArray) -> tuple[FloatArray, str]:
    """Return the tip's position (N,) mm, the travel less the bending of the cantilever, and a line on it.

    The bending is force over spring constant (1 N/m is 1 mN/mm), from that of the first samples on.
    """
    spring = curve.metadata.get("spring constant")
    if spring is None or not (np.isfinite(spring) and spring > 0):
        return travel_mm, (
            "WARNING: the spring constant of the cantilever is not stated: position is its travel, and the tip "
            "stands short of it by the bending; depth is overstated"
        )
    bending_mm = (force_mn - float(np.median(force_mn[:50]))) / float(spring)
    deepest_um = 1e3 * float(np.max(bending_mm))
    return travel_mm - bending_mm, (
        f"position is the tip's: travel less the bending of the cantilever, force over {spring:.4g} N/m, "
        f"at most {deepest_um:.4g} um"
    )


def _column(curve: Any, name: str) -> FloatArray:
    return np.array(curve[name], dtype=np.float64)


def _speed(curve: Any, name: str) -> float | None:
    speed = curve.metadata.get(name)
    return None if speed is None or not np.isfinite(speed) else 1e3 * abs(float(speed))


def _started(curve: Any) -> tuple[str, str]:
    """Return the time of recording as ISO 8601 with offset, and what was assumed; empty if not stated."""
    text = f"{curve.metadata.get('date', '')}T{curve.metadata.get('time', '')}"
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return "", ""
    return moment.astimezone().isoformat(), f"recorded {text}, time zone not stated, this computer's assumed"


def _spans(segment: NDArray[np.int_]) -> list[tuple[int, int]]:
    edges = [0, *(np.flatnonzero(np.diff(segment)) + 1).tolist(), len(segment)]
    return list(pairwise(edges))


def _direction(height_mm: FloatArray, force_mn: FloatArray) -> tuple[float, str]:
    """Return the sign that makes position positive into the specimen: where force is high, it is deep."""
    high = force_mn >= np.percentile(force_mn, 90)
    falls = float(height_mm[high].mean()) < float(height_mm[~high].mean())
    if falls:
        return -1.0, "height falls towards the specimen, so that position is its negative"
    return 1.0, "height rises towards the specimen, so that position follows it"


def _phases(
    spans: list[tuple[int, int]], time_s: FloatArray, position_mm: FloatArray, grid: FloatArray
) -> tuple[tuple[Phase, ...], str]:
    """Name the segments by how the position moves in each: in, rest, out."""
    travel = float(np.ptp(position_mm))
    moves = [float(position_mm[b - 1] - position_mm[a]) / travel if travel else 0.0 for a, b in spans]
    ramp = next((i for i, move in enumerate(moves) if move > 0.2), None)
    if ramp is None:
        return (), "phases: none, no segment moves towards the specimen"
    names = []
    for i, move in enumerate(moves):
        if i < ramp:
            names.append("approach")
        elif i == ramp:
            names.append("ramp")
        elif move < -0.2:
            names.append("retract")
        else:
            names.append("clear" if "retract" in names else "hold")
    starts = [int(np.searchsorted(grid, time_s[a] - 1e-9)) for a, _ in spans] + [len(grid)]
    phases: list[Phase] = []
    for name, start, stop in zip(names, starts, starts[1:], strict=False):
        if phases and phases[-1].name == name:
            phases[-1] = Phase(name, phases[-1].start, stop)
        elif stop > start:
            phases.append(Phase(name, start, stop))
    return tuple(phases), f"phases from the {len(spans)} segments: {', '.join(p.name for p in phases)}"
