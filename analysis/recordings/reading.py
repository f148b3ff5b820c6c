"""The reader of trial files: strict once, at the edge, so that nothing behind it has to check again."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from analysis.errors import BadInputError
from analysis.recordings.layout import (
    CONSTANT_NAMES,
    NATIVE_SIGNALS,
    Attribute,
    Value,
    attributes_of,
    finite,
)
from analysis.recordings.probing import probe
from analysis.recordings.sealing import seal_state
from analysis.recordings.trial import (
    PHASE_NAMES,
    Calibration,
    Event,
    FloatArray,
    NativeSamples,
    Phase,
    ProtocolSummary,
    Specimen,
    Surface,
    Trial,
)

# what h5py raises on a damaged file; UnicodeDecodeError is a ValueError
_HDF5_ERRORS = (OSError, KeyError, RuntimeError, ValueError, TypeError, OverflowError, MemoryError)
_MAX_SAMPLES = 2**31
_MAX_ROWS = 1_000_000


def read_trial(path: Path) -> Trial:
    """Read and check a trial file.

    A file whose status is ``running`` was cut off (or is still written): its unwritten tail is left
    away and the status kept. Raises BadInputError, one line, on anything that is wrong. A file of another
    program carries no seal; it is read in a process of its own first, as HDF5 may crash on a damaged one.
    """
    path = Path(path)
    _check_is_file(path)
    state = seal_state(path)
    if state == "broken":
        raise BadInputError(
            f"{path}: its contents do not agree with its checksum: it is damaged, copy it again"
        )
    if state == "absent":
        probe(path)
    return read_unchecked(path)


def read_unchecked(path: Path) -> Trial:
    """Read a trial file that the HDF5 library is known to survive."""
    with _open(path) as file:
        with _access(path, "the file's structure"):
            root = _attributes(path, file, "/")
            signals = _group(path, file, "signals")
            rate = _attributes(path, signals, "/signals")["sample_rate_hz"]
        running = root["status"] == "running"
        position_v, force_v, command_v = _signals(path, signals, running=running)
        n_samples = len(position_v)
        return Trial(
            **_trial_fields(root),
            sample_rate_hz=rate,
            position_v=position_v,
            force_v=force_v,
            command_v=command_v,
            calibration=_calibration(path, file, commanded=command_v is not None),
            phases=_phases(path, file, n_samples, clip=running),
            surface=_surface(path, file),
            protocol=_protocol(path, file),
            specimen=Specimen(**_optional_attributes(path, file, "specimen")),
            events=_events(path, file),
            log=_log(path, file),
            native=_native(path, file),
            other_channels=_other_channels(path, file),
            path=str(path),
        )


@contextmanager
def _open(path: Path) -> Iterator[Any]:
    """Open an HDF5 file for reading; BadInputError says what is wrong with one that can't be."""
    try:
        file = h5py.File(path, "r", locking="best-effort")
    except _HDF5_ERRORS as error:
        raise BadInputError(_why_not_opened(path, error)) from error
    with file:
        yield file


def _check_is_file(path: Path) -> None:
    if path.is_dir():
        raise BadInputError(
            f"{path}: is a folder, not a trial file: give a file, or a folder that holds *.h5"
        )
    try:
        with path.open("rb") as file:
            start = file.read(8)
    except FileNotFoundError as error:
        raise BadInputError(f"{path}: no such file: check the name") from error
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise BadInputError(f"{path}: can't be opened ({reason}): check its permissions") from error
    if not start:
        raise BadInputError(f"{path}: is empty (0 bytes): copy it again from where it was recorded")


def _why_not_opened(path: Path, error: BaseException) -> str:
    text = _one_line(error)
    if "truncated file" in text:
        sizes = re.search(r"eof = (\d+).*stored_eof = (\d+)", text)
        size = f" after {sizes[1]} of {sizes[2]} bytes" if sizes else ""
        return f"{path}: is cut short{size}: copy it again, or try `indenter rescue` on a copy"
    if "signature not found" in text:
        return f"{path}: is not an HDF5 file: text and .ddf recordings are brought in by `indenter import`"
    return f"{path}: can't be opened as HDF5 ({text}): the file is damaged, copy it again"


def _one_line(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return (text or type(error).__name__)[:200]


@contextmanager
def _access(path: Path, where: str) -> Iterator[None]:
    """Translate what h5py raises on damaged contents into one line that names the place."""
    try:
        yield
    except BadInputError:
        raise
    except _HDF5_ERRORS as error:
        raise BadInputError(
            f"{path}: {where} can't be read ({_one_line(error)}): the file is damaged, copy it again"
        ) from error


def _bad(path: Path, where: str, what: str, todo: str) -> BadInputError:
    return BadInputError(f"{path}: {where} {what}: {todo}")


# groups and attributes


def _group(path: Path, file: Any, name: str) -> Any:
    group = file.get(name)
    if not isinstance(group, h5py.Group):
        raise _bad(path, f"/{name}", "is missing", "this is no trial file, or one cut off while it was made")
    return group


def _optional_attributes(path: Path, file: Any, name: str) -> dict[str, Any]:
    with _access(path, f"/{name}"):
        group = file.get(name)
        return _attributes(path, group, f"/{name}") if isinstance(group, h5py.Group) else {}


def _attributes(path: Path, group: Any, name: str, *, optional: bool = False) -> dict[str, Any]:
    """Return the declared attributes of a group, checked, defaults filled in."""
    present = set(group.attrs)
    values: dict[str, Any] = {}
    for attribute in attributes_of(name):
        if attribute.name in present:
            with _access(path, attribute.where):
                raw = group.attrs[attribute.name]
            values[attribute.name] = _checked(path, attribute, raw)
        elif attribute.required and not optional:
            raise _bad(path, attribute.where, "is missing", f"it must say: {attribute.meaning}")
        else:
            values[attribute.name] = attribute.default
    return values


def _checked(path: Path, attribute: Attribute, raw: Any) -> Value:
    value = _converted(path, attribute, raw)
    wrong = attribute.check(value) if attribute.check else None
    if wrong:
        shown = repr(value)[:60]
        raise _bad(path, attribute.where, f"is {shown}", f"it {wrong}")
    return value


def _converted(path: Path, attribute: Attribute, raw: Any) -> Value:
    """Accept what other programs write: str, bytes, numpy scalars, arrays of one element."""
    if isinstance(raw, np.ndarray) and raw.size == 1:
        raw = raw.reshape(-1)[0]
    if isinstance(raw, np.generic):
        raw = raw.item()
    if attribute.type is str:
        if isinstance(raw, str | bytes):
            return _text(path, attribute.where, raw)
        if isinstance(raw, h5py.Empty):
            return ""
        raise _bad(path, attribute.where, f"is not a text but {type(raw).__name__}", attribute.meaning)
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        kind = "a whole number" if attribute.type is int else "a number"
        raise _bad(path, attribute.where, f"is {raw!r:.60}", f"it must be {kind} ({attribute.meaning})")
    if attribute.type is float:
        return float(raw)
    if isinstance(raw, float) and not raw.is_integer():
        raise _bad(path, attribute.where, f"is {raw!r}", "it must be a whole number")
    return int(raw)


def _text(path: Path, where: str, raw: str | bytes) -> str:
    """Decode fixed-length or variable text; h5py hands undecodable bytes on as surrogates."""
    try:
        data = raw if isinstance(raw, bytes) else raw.encode("utf-8", "surrogateescape")
        return data.rstrip(b"\0").decode("utf-8")
    except UnicodeError as error:
        raise _bad(path, where, "is not UTF-8 text", "write it as UTF-8") from error


def _trial_fields(root: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in root.items() if name not in {"format", "format_version"}}


def _calibration(path: Path, file: Any, *, commanded: bool) -> Calibration:
    with _access(path, "/calibration"):
        group = _group(path, file, "calibration")
        values = _attributes(path, group, "/calibration")
        if commanded:
            for name in ("command_volts_per_mm", "command_zero_v"):
                if name not in group.attrs:
                    raise _bad(path, f"/calibration/{name}", "is missing", "it is needed with command_v")
    errors = {name: values.pop(f"{name}_se") for name in CONSTANT_NAMES}
    known = {name: error for name, error in errors.items() if error is not None}
    return Calibration(**values, standard_errors=known)


def _surface(path: Path, file: Any) -> Surface | None:
    values = _optional_attributes(path, file, "surface")
    return Surface(**values) if values else None


def _protocol(path: Path, file: Any) -> ProtocolSummary:
    values = _optional_attributes(path, file, "protocol")
    with _access(path, "/protocol/toml"):
        dataset = file.get("protocol/toml")
        toml = dataset[()] if isinstance(dataset, h5py.Dataset) and dataset.shape == () else b""
        text = _text(path, "/protocol/toml", toml) if isinstance(toml, str | bytes) else ""
    return ProtocolSummary(**values, toml=text)


# signals


def _signals(path: Path, group: Any, *, running: bool) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    arrays: dict[str, FloatArray] = {}
    for name in ("position_v", "force_v", "command_v"):
        where = f"/signals/{name}"
        with _access(path, where):
            if name not in group:
                if name == "command_v":
                    continue
                raise _bad(path, where, "is missing", "a trial needs position_v and force_v")
            arrays[name] = _vector(path, where, group[name])
    lengths = {name: len(array) for name, array in arrays.items()}
    if len(set(lengths.values())) != 1:
        shown = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise _bad(path, "/signals", f"differ in length ({shown})", "every channel has one value a sample")
    if running:
        written = min(_written(array) for array in arrays.values())
        arrays = {name: array[:written] for name, array in arrays.items()}
    if len(arrays["position_v"]) == 0:
        raise _bad(path, "/signals", "hold no samples", "nothing was recorded; leave the file out")
    for name, array in arrays.items():
        _check_samples(path, f"/signals/{name}", array)
    return arrays["position_v"], arrays["force_v"], arrays.get("command_v")


def _vector(path: Path, where: str, dataset: Any) -> FloatArray:
    """Read a 1-D numeric dataset as (N,) float64, never more than the file can hold."""
    if not isinstance(dataset, h5py.Dataset) or dataset.ndim != 1 or dataset.dtype.kind not in "fiu":
        raise _bad(path, where, "is not a 1-D array of numbers", "write one number a sample")
    stored = dataset.id.get_storage_size()
    # compressed data may be much smaller than what it unpacks to, but not without bound
    if len(dataset) > _MAX_SAMPLES or len(dataset) * dataset.dtype.itemsize > 2000 * (stored + 4096):
        raise _bad(path, where, f"claims {len(dataset)} samples, more than are stored", "the file is damaged")
    values: FloatArray = np.empty(len(dataset), dtype=np.float64)
    if len(dataset):
        dataset.read_direct(values)
    return values


def _written(array: FloatArray) -> int:
    """Length of the array without the NaN of its unwritten tail; the end is looked for in blocks."""
    stop = len(array)
    while stop:
        start = max(0, stop - 65536)
        block = np.flatnonzero(~np.isnan(array[start:stop]))
        if block.size:
            return int(start + block[-1] + 1)
        stop = start
    return 0


def _check_samples(path: Path, where: str, array: FloatArray) -> None:
    """Check that every sample is finite and of a size that can be calculated with."""
    # the extremes of an array with a NaN are NaN, so that no array of flags is needed for a good one
    if len(array) == 0 or not (finite(float(array.min())) or finite(float(array.max()))):
        return
    bad = np.flatnonzero([finite(float(value)) is not None for value in array])
    raise _bad(
        path,
        where,
        f"is {array[bad[0]]} at sample {bad[0]} ({bad.size} such)",
        "record it again, or cut the trial before it",
    )


# tables


def _table(path: Path, file: Any, name: str, fields: tuple[str, ...]) -> NDArray[Any] | None:
    with _access(path, f"/{name}"):
        dataset = file.get(name)
        if not isinstance(dataset, h5py.Dataset):
            return None
        names = dataset.dtype.names or ()
        if dataset.ndim != 1 or any(field not in names for field in fields) or len(dataset) > _MAX_ROWS:
            raise _bad(
                path, f"/{name}", f"is not a table of {', '.join(fields)}", "write it as formats.md says"
            )
        rows: NDArray[Any] = dataset[()]
        return rows


def _whole(path: Path, where: str, raw: Any) -> int:
    value = raw.item() if isinstance(raw, np.generic) else raw
    if isinstance(value, bool) or not isinstance(value, int | float) or int(value) != value:
        raise _bad(path, where, f"has {value!r:.40} for a sample", "it must be a whole number")
    return int(value)


def _phases(path: Path, file: Any, n_samples: int, *, clip: bool) -> tuple[Phase, ...]:
    """Return the phases in order; empty ones say nothing and are left away."""
    rows = _table(path, file, "phases", ("name", "start", "stop"))
    if rows is None:
        raise _bad(path, "/phases", "is missing", "it must list name, start and stop of each phase")
    phases: list[Phase] = []
    for number, row in enumerate(rows):
        where = f"/phases row {number}"
        with _access(path, where):
            name = _text(path, where, row["name"])
            start, stop = _whole(path, where, row["start"]), _whole(path, where, row["stop"])
        if not name and clip:
            continue  # a row of a running file that was not written yet
        if name not in PHASE_NAMES:
            raise _bad(path, where, f"is named {name!r:.40}", f"known are {', '.join(PHASE_NAMES)}")
        if clip:
            start, stop = min(start, n_samples), min(stop, n_samples)
        earliest = phases[-1].stop if phases else 0
        if not earliest <= start <= stop <= n_samples:
            raise _bad(
                path,
                where,
                f"({name}) runs from {start} to {stop}",
                f"it must lie between {earliest} and {n_samples}, in order",
            )
        if stop > start:
            phases.append(Phase(name, start, stop))
    return tuple(phases)


def _events(path: Path, file: Any) -> tuple[Event, ...]:
    rows = _table(path, file, "events", ("sample", "kind", "message"))
    events: list[Event] = []
    for number, row in enumerate(rows if rows is not None else ()):
        where = f"/events row {number}"
        with _access(path, where):
            kind = _text(path, where, row["kind"])
            message = _text(path, where, row["message"])
            sample = _whole(path, where, row["sample"])
        if kind or message:
            events.append(Event(sample, kind, message))
    return tuple(events)


def _log(path: Path, file: Any) -> tuple[str, ...]:
    with _access(path, "/log"):
        dataset = file.get("log")
        if not isinstance(dataset, h5py.Dataset) or dataset.shape is None:
            return ()
        lines = np.atleast_1d(dataset[()]).ravel()
        return tuple(_text(path, "/log", line) for line in lines if isinstance(line, str | bytes))


def _native(path: Path, file: Any) -> NativeSamples | None:
    with _access(path, "/import"):
        group = file.get("import")
        if not isinstance(group, h5py.Group) or any(name not in group for name in NATIVE_SIGNALS):
            return None
        arrays = {name: _vector(path, f"/import/{name}", group[name]) for name in NATIVE_SIGNALS}
    if len({len(array) for array in arrays.values()}) != 1:
        raise _bad(path, "/import", "has columns of different length", "import the recording again")
    for name, array in arrays.items():
        _check_samples(path, f"/import/{name}", array)
    if not np.all(np.diff(arrays["time_s"]) > 0):
        raise _bad(path, "/import/time_s", "does not rise", "import the recording again")
    return NativeSamples(**arrays)


def _other_channels(path: Path, file: Any) -> dict[str, FloatArray]:
    with _access(path, "/import/channels"):
        group = file.get("import/channels")
        if not isinstance(group, h5py.Group):
            return {}
        return {name: _vector(path, f"/import/channels/{name}", group[name]) for name in group}
