"""Many trials as curves for one plot: read, put on one axis, and thinned to what a screen can show."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from analysis.errors import BadInputError
from analysis.recordings.attributes import attributes_in, group_of
from analysis.recordings.live.locking import is_locked
from analysis.recordings.opening import access, open_file
from analysis.recordings.reading import read_trial
from analysis.recordings.sealing import seal_state
from analysis.recordings.tables import read_phases
from analysis.recordings.trial import Calibration, Phase
from rig.gui.jobs.decimation import extremes

Shown = Literal["force over time", "position over time", "force over position"]
Origin = Literal["first sample", "start of the ramp", "end of the ramp"]
Scale = Literal["as recorded", "share of the largest", "per mm of depth"]
SHOWN: tuple[Shown, ...] = ("force over time", "position over time", "force over position")
ORIGINS: tuple[Origin, ...] = ("first sample", "start of the ramp", "end of the ramp")
SCALES: tuple[Scale, ...] = ("as recorded", "share of the largest", "per mm of depth")

_KEPT_BYTES = 192_000_000
_CONSTANTS = ("volts_per_mm", "position_zero_v", "volts_per_mn", "force_zero_v")
_OFFSET_SHARE = 0.02
"""Of a trial's first samples, which lie before contact, the force is taken as that of the free arm."""


@dataclass(frozen=True, slots=True)
class Axes:
    """What is drawn over what. ``scale`` divides the force less that of the free arm."""

    shown: Shown = "force over time"
    origin: Origin = "first sample"
    scale: Scale = "as recorded"

    @property
    def over_time(self) -> bool:
        """Whether the abscissa is time."""
        return self.shown != "force over position"

    @property
    def labels(self) -> tuple[tuple[str, str], tuple[str, str]]:
        """Name and unit of abscissa and ordinate."""
        x = (f"time from the {self.origin}", "s") if self.over_time else ("position", "mm")
        if self.shown == "position over time":
            return x, ("position", "mm")
        unit = {"as recorded": "mN", "share of the largest": "", "per mm of depth": "mN/mm"}[self.scale]
        return x, ("force", unit)


@dataclass(frozen=True, slots=True)
class Trace:
    """One trial as a curve (M,) float32; ``problem`` says why there is none."""

    path: str
    x: NDArray[np.float32]
    y: NDArray[np.float32]
    problem: str = ""


@dataclass(frozen=True, slots=True)
class _Samples:
    """What is kept of a file that was read: signals (N,) as float32, to the sample as recorded."""

    position_mm: NDArray[np.float32]
    force_mn: NDArray[np.float32]
    sample_rate_hz: float
    phases: tuple[Phase, ...]
    depth_mm: float | None

    @property
    def n_bytes(self) -> int:
        return self.position_mm.nbytes + self.force_mn.nbytes


_kept: OrderedDict[tuple[str, int, int], _Samples] = OrderedDict()


def read_traces(
    paths: Sequence[str], axes: Axes, bins: int, span: tuple[float, float] | None = None
) -> tuple[Trace, ...]:
    """Return one curve a file, of at most 2 ``bins`` points or so.

    ``span`` cuts the abscissa, where that is time: a stretch is then thinned less. Files that are read stay
    in memory up to some 190 MB, so that zooming reads none again.
    """
    traces = []
    for path in paths:
        try:
            traces.append(_trace(path, _samples(path), axes, bins, span))
        except (BadInputError, OSError) as error:
            empty = np.empty(0, dtype=np.float32)
            traces.append(Trace(path, empty, empty, str(error)))
    return tuple(traces)


def _trace(path: str, samples: _Samples, axes: Axes, bins: int, span: tuple[float, float] | None) -> Trace:
    rate = samples.sample_rate_hz
    zero = _zero(samples, axes.origin)
    start, stop = 0, len(samples.force_mn)
    if span is not None and axes.over_time:
        start, stop = (int(np.clip(np.floor(edge * rate) + zero, 0, stop)) for edge in span)
    y = samples.position_mm if axes.shown == "position over time" else samples.force_mn
    at = extremes(y, bins, start, stop)
    x = (at - zero) / rate if axes.over_time else samples.position_mm[at]
    shown = y[at] if axes.shown == "position over time" else _scaled(samples, y[at], axes.scale)
    return Trace(path, np.asarray(x, dtype=np.float32), np.asarray(shown, dtype=np.float32))


def _zero(samples: _Samples, origin: Origin) -> int:
    """Return the sample that counts as time zero; the first where the trial has no such phase."""
    names = {"start of the ramp": "ramp", "end of the ramp": "hold"}
    wanted = names.get(origin)
    return next((phase.start for phase in samples.phases if phase.name == wanted), 0)


def _scaled(samples: _Samples, force_mn: NDArray[np.float32], scale: Scale) -> NDArray[np.float32]:
    if scale == "as recorded":
        return force_mn
    free = samples.force_mn[: max(1, int(_OFFSET_SHARE * len(samples.force_mn)))]
    offset_mn = float(np.median(free))
    unit = float(samples.force_mn.max()) - offset_mn if scale == "share of the largest" else samples.depth_mm
    if not unit:
        raise BadInputError("its depth is not known: choose another scale")
    return (force_mn - np.float32(offset_mn)) / np.float32(unit)


def _samples(path: str) -> _Samples:
    status = Path(path).stat()
    key = (path, status.st_size, status.st_mtime_ns)
    if key not in _kept:
        _kept[key] = _read(Path(path))
        while len(_kept) > 1 and sum(samples.n_bytes for samples in _kept.values()) > _KEPT_BYTES:
            _kept.popitem(last=False)
    _kept.move_to_end(key)
    return _kept[key]


def _read(path: Path) -> _Samples:
    if is_locked(path):
        raise BadInputError(f"{path}: is being written: look at it when the trial has ended")
    if seal_state(path) == "intact":
        return _read_sealed(path)
    trial = read_trial(path)
    return _Samples(
        trial.position_mm.astype(np.float32),
        trial.force_mn.astype(np.float32),
        trial.sample_rate_hz,
        trial.phases,
        trial.protocol.depth_mm,
    )


def _read_sealed(path: Path) -> _Samples:
    """Read what a curve needs of a file that this program wrote and nobody has changed since."""
    with open_file(path) as file, access(path, "the file's structure"):
        calibration = attributes_in(path, group_of(path, file, "calibration"), "/calibration", _CONSTANTS)
        signals = group_of(path, file, "signals")
        position_v, force_v = signals["position_v"][()], signals["force_v"][()]
        rate = attributes_in(path, signals, "/signals")["sample_rate_hz"]
        protocol = file.get("protocol")
        stated = attributes_in(path, protocol, "/protocol", ("depth_mm",)) if protocol is not None else {}
        phases = read_phases(path, file, len(position_v), clip=False)
    c = Calibration(**{"command_volts_per_mm": 1.0, "command_zero_v": 0.0} | calibration)
    return _Samples(
        ((position_v - c.position_zero_v) / c.volts_per_mm).astype(np.float32),
        ((force_v - c.force_zero_v) / c.volts_per_mn).astype(np.float32),
        rate,
        phases,
        stated.get("depth_mm"),
    )
