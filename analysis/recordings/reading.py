"""The reader of trial files: strict once, at the edge, so that nothing behind it has to check again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from analysis.errors import BadInputError
from analysis.recordings.attributes import attributes_in, group_of, optional_attributes, text_of
from analysis.recordings.checks import samples_problem
from analysis.recordings.layout import CONSTANT_NAMES, NATIVE_SIGNALS, RUNNING_SURFACE, SIGNALS
from analysis.recordings.opening import access, bad_input, check_is_file, open_file
from analysis.recordings.own_storage import refuse_foreign_storage
from analysis.recordings.probing import probe
from analysis.recordings.sealing import seal_state
from analysis.recordings.tables import read_events, read_log, read_phases
from analysis.recordings.trial import (
    Calibration,
    FloatArray,
    NativeSamples,
    ProtocolSummary,
    Specimen,
    Surface,
    Trial,
)

_MAX_SAMPLES = 2**31


def read_trial(path: Path) -> Trial:
    """Read and check a trial file.

    A file whose status is ``running`` was cut off (or is still written): its unwritten tail is left
    away and the status kept. Raises BadInputError, one line, on anything that is wrong. A file of another
    program carries no seal; it is read in a process of its own first, as HDF5 may crash on a damaged one.
    """
    path = Path(path)
    check_is_file(path)
    state = seal_state(path)
    if state == "broken":
        raise BadInputError(
            f"{path}: its contents do not agree with its checksum: it is damaged, copy it again"
        )
    if state == "absent":
        probe(path)
    return read_unchecked(path)


def read_unchecked(path: Path, *, cut: bool = False) -> Trial:
    """Read a trial file that the HDF5 library is known to survive.

    `cut` says that the file lacks its end, whatever its status: NaN at the end of a signal is left away.
    """
    with open_file(path) as file:
        refuse_foreign_storage(path, file)
        with access(path, "the file's structure"):
            root = attributes_in(path, file, "/")
            signals = group_of(path, file, "signals")
            rate = attributes_in(path, signals, "/signals")["sample_rate_hz"]
        running = cut or root["status"] == "running"
        position_v, force_v, command_v = _signals(path, signals, running=running)
        n_samples = len(position_v)
        return Trial(
            **_trial_fields(root),
            sample_rate_hz=rate,
            position_v=position_v,
            force_v=force_v,
            command_v=command_v,
            calibration=_calibration(path, file, commanded=command_v is not None),
            phases=read_phases(path, file, n_samples, clip=running),
            surface=_surface(path, file),
            protocol=_protocol(path, file),
            specimen=Specimen(**optional_attributes(path, file, "specimen")),
            events=read_events(path, file, clip=running),
            log=read_log(path, file),
            native=_native(path, file),
            other_channels=_other_channels(path, file),
            path=str(path),
        )


def _trial_fields(root: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in root.items() if name not in {"format", "format_version"}}


def _calibration(path: Path, file: Any, *, commanded: bool) -> Calibration:
    with access(path, "/calibration"):
        group = group_of(path, file, "calibration")
        values = attributes_in(path, group, "/calibration")
        if commanded:
            for name in ("command_volts_per_mm", "command_zero_v"):
                if name not in group.attrs:
                    raise bad_input(path, f"/calibration/{name}", "is missing", "it is needed with command_v")
    errors = {name: values.pop(f"{name}_se") for name in CONSTANT_NAMES}
    known = {name: error for name, error in errors.items() if error is not None}
    return Calibration(**values, standard_errors=known)


def _surface(path: Path, file: Any) -> Surface | None:
    values = optional_attributes(path, file, "surface")
    if values:
        return Surface(**values)
    with access(path, f"/{RUNNING_SURFACE}"):
        found = file.get(RUNNING_SURFACE)
        if not isinstance(found, h5py.Dataset) or found.shape != (4,) or found.dtype.kind != "f":
            return None
        position_mm, sample, overshoot_um, threshold_mn = (float(value) for value in found[()])
    if not np.isfinite([position_mm, sample, overshoot_um, threshold_mn]).all():
        return None
    return Surface(position_mm, round(sample), overshoot_um, threshold_mn)


def _protocol(path: Path, file: Any) -> ProtocolSummary:
    values = optional_attributes(path, file, "protocol")
    with access(path, "/protocol/toml"):
        dataset = file.get("protocol/toml")
        text = ""
        if isinstance(dataset, h5py.Dataset) and dataset.size == 1:
            text = text_of(path, "/protocol/toml", np.atleast_1d(dataset[()]).ravel()[0])
    return ProtocolSummary(**values, toml=text)


# signals


def _signals(path: Path, group: Any, *, running: bool) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    arrays: dict[str, FloatArray] = {}
    for name in SIGNALS:
        where = f"/signals/{name}"
        with access(path, where):
            if name not in group:
                if name == "command_v":
                    continue
                raise bad_input(path, where, "is missing", "a trial needs position_v and force_v")
            arrays[name] = _vector(path, where, group[name])
    lengths = {name: len(array) for name, array in arrays.items()}
    if len(set(lengths.values())) != 1:
        shown = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise bad_input(
            path, "/signals", f"differ in length ({shown})", "every channel has one value a sample"
        )
    if running:
        written = min(_written(array) for array in arrays.values())
        arrays = {name: array[:written] for name, array in arrays.items()}
    if len(arrays["position_v"]) == 0:
        raise bad_input(path, "/signals", "hold no samples", "nothing was recorded; leave the file out")
    for name, array in arrays.items():
        _check_samples(path, f"/signals/{name}", array)
    return arrays["position_v"], arrays["force_v"], arrays.get("command_v")


def _vector(path: Path, where: str, dataset: Any) -> FloatArray:
    """Read a 1-D numeric dataset as (N,) float64, never more than the file can hold."""
    if not isinstance(dataset, h5py.Dataset) or dataset.ndim != 1 or dataset.dtype.kind not in "fiu":
        raise bad_input(path, where, "is not a 1-D array of numbers", "write one number a sample")
    stored = dataset.id.get_storage_size()
    # compressed data may be much smaller than what it unpacks to, but not without bound
    if len(dataset) > _MAX_SAMPLES or len(dataset) * dataset.dtype.itemsize > 2000 * (stored + 4096):
        raise bad_input(
            path, where, f"claims {len(dataset)} samples, more than are stored", "the file is damaged"
        )
    values: FloatArray = np.empty(len(dataset), dtype=np.float64)
    if len(dataset):
        dataset.read_direct(values)
    return values


def _written(array: FloatArray) -> int:
    """Length of the array up to the first NaN: what is being written meanwhile may be read in any order."""
    for start in range(0, len(array), 65536):
        unwritten = np.isnan(array[start : start + 65536])
        if unwritten.any():
            return start + int(np.argmax(unwritten))
    return len(array)


def _check_samples(path: Path, where: str, array: FloatArray) -> None:
    problem = samples_problem(array)
    if problem:
        raise bad_input(path, where, problem, "record it again, or cut the trial before it")


def _native(path: Path, file: Any) -> NativeSamples | None:
    with access(path, "/import"):
        group = file.get("import")
        if not isinstance(group, h5py.Group) or any(name not in group for name in NATIVE_SIGNALS):
            return None
        arrays = {name: _vector(path, f"/import/{name}", group[name]) for name in NATIVE_SIGNALS}
    if len({len(array) for array in arrays.values()}) != 1:
        raise bad_input(path, "/import", "has columns of different length", "import the recording again")
    for name, array in arrays.items():
        _check_samples(path, f"/import/{name}", array)
    if not np.all(np.diff(arrays["time_s"]) > 0):
        raise bad_input(path, "/import/time_s", "does not rise", "import the recording again")
    return NativeSamples(**arrays)


def _other_channels(path: Path, file: Any) -> dict[str, FloatArray]:
    with access(path, "/import/channels"):
        group = file.get("import/channels")
        if not isinstance(group, h5py.Group):
            return {}
        channels = {name: _vector(path, f"/import/channels/{name}", group[name]) for name in group}
    for name, array in channels.items():
        _check_samples(path, f"/import/channels/{name}", array)
    return channels
