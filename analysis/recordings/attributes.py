"""Reading a group's attributes as the layout declares them, from whatever program wrote them."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from analysis.recordings.layout import Attribute, Value, attributes_of
from analysis.recordings.opening import access, bad_input


def group_of(path: Path, file: Any, name: str) -> Any:
    """Return a group that every trial file has."""
    group = file.get(name)
    if not isinstance(group, h5py.Group):
        raise bad_input(
            path, f"/{name}", "is missing", "this is no trial file, or one cut off while it was made"
        )
    return group


def optional_attributes(path: Path, file: Any, name: str) -> dict[str, Any]:
    """Return the declared attributes of a group that may be absent, then empty."""
    with access(path, f"/{name}"):
        group = file.get(name)
        return attributes_in(path, group, f"/{name}") if isinstance(group, h5py.Group) else {}


def attributes_in(path: Path, group: Any, name: str, only: Collection[str] | None = None) -> dict[str, Any]:
    """Return the declared attributes of a group (``only`` those named), checked, defaults filled in."""
    stored = group.attrs
    present = set(stored) if only is None else {wanted for wanted in only if wanted in stored}
    values: dict[str, Any] = {}
    for attribute in attributes_of(name):
        if only is not None and attribute.name not in only:
            continue
        if attribute.name in present:
            with access(path, attribute.where):
                raw = stored[attribute.name]
            values[attribute.name] = _checked(path, attribute, raw)
        elif attribute.required:
            raise bad_input(path, attribute.where, "is missing", f"it must say: {attribute.meaning}")
        else:
            values[attribute.name] = attribute.default
    return values


def _checked(path: Path, attribute: Attribute, raw: Any) -> Value:
    value = _converted(path, attribute, raw)
    wrong = attribute.check(value) if attribute.check else None
    if wrong:
        shown = repr(value)[:60]
        raise bad_input(path, attribute.where, f"is {shown}", f"it {wrong}")
    return value


def _converted(path: Path, attribute: Attribute, raw: Any) -> Value:
    """Accept what other programs write: str, bytes, numpy scalars, arrays of one element."""
    if isinstance(raw, np.ndarray) and raw.size == 1:
        raw = raw.reshape(-1)[0]
    if isinstance(raw, np.generic):
        raw = raw.item()
    if attribute.type is str:
        return "" if isinstance(raw, h5py.Empty) else text_of(path, attribute.where, raw)
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        kind = "a whole number" if attribute.type is int else "a number"
        raise bad_input(path, attribute.where, f"is {raw!r:.60}", f"it must be {kind} ({attribute.meaning})")
    if attribute.type is float:
        return float(raw)
    if isinstance(raw, float) and not raw.is_integer():
        raise bad_input(path, attribute.where, f"is {raw!r}", "it must be a whole number")
    return int(raw)


def text_of(path: Path, where: str, raw: Any) -> str:
    """Decode fixed-length or variable text; h5py hands undecodable bytes on as surrogates."""
    if not isinstance(raw, str | bytes):
        raise bad_input(path, where, f"is not a text but {type(raw).__name__}", "write it as UTF-8 text")
    try:
        data = raw if isinstance(raw, bytes) else raw.encode("utf-8", "surrogateescape")
        return data.rstrip(b"\0").decode("utf-8")
    except UnicodeError as error:
        raise bad_input(path, where, "is not UTF-8 text", "write it as UTF-8") from error
