"""Reads rig.toml and protocol.toml into checked, frozen models; every fault becomes one clear line."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails

from analysis.errors import BadInputError
from rig.settings import protocol_file, rig_file
from rig.settings.protocol_file import Protocol, Study, TrialProtocol, WithSurface
from rig.settings.rig_file import RigFile, TlsSettings

__all__ = [
    "check_protocol_on_rig",
    "load_protocol",
    "load_rig",
    "parse_protocol",
    "parse_rig",
    "protocol_faults",
]

T = TypeVar("T")
_PROTOCOL: TypeAdapter[Protocol] = TypeAdapter(Protocol)
_RIG: TypeAdapter[RigFile] = TypeAdapter(RigFile)
_REMEDIES = {
    "float_type": "write a bare number, its unit stands in the key's name",
    "int_type": "write a whole number",
    "finite_number": "write a number",
    "string_type": "put it in quotes",
    "tuple_type": "write a list, [a, b]",
    "model_type": "write it as a table",
    "bool_type": "write true or false",
}


def load_rig(path: Path) -> RigFile:
    """Read a rig file (see rig/examples/rig.toml); BadInputError names file, key, value and what to do."""
    rig = parse_rig(_read_text(path), str(path))
    if rig.card.tls is None:
        return rig
    # as written in the file: beside it
    files = {key: str(path.parent.absolute() / file) for key, file in rig.card.tls.model_dump().items()}
    return rig.model_copy(update={"card": rig.card.model_copy(update={"tls": TlsSettings(**files)})})


def load_protocol(path: Path) -> Protocol:
    """Read a protocol file (see rig/examples/*.toml); BadInputError as for `load_rig`."""
    return parse_protocol(_read_text(path), str(path))


def parse_rig(text: str, origin: str) -> RigFile:
    """Check the text of a rig file; ``origin`` names it in messages."""
    return _checked(_RIG, _parse_toml(text, origin), origin)


def parse_protocol(text: str, origin: str) -> Protocol:
    """Check the text of a protocol file; ``origin`` names it in messages."""
    return _checked(_PROTOCOL, _parse_toml(text, origin), origin)


def protocol_faults(data: Mapping[str, Any]) -> dict[str, str]:
    """Return what is wrong with the values of a protocol, one line by dotted key; empty where nothing is."""
    try:
        _PROTOCOL.validate_python(_lists_to_tuples(data))
    except ValidationError as error:
        faults = error.errors(include_url=False)
        return {_key(fault, data): _told(fault, faults, data) for fault in faults}
    return {}


def check_protocol_on_rig(protocol: Protocol, rig: RigFile, origin: str) -> None:
    """Refuse (BadInputError) a protocol that asks for more than this rig's lever may do."""
    lever = rig.lever
    travel_mm = lever.travel_max_mm - lever.travel_min_mm
    for key, speed_mm_s in protocol.speeds_mm_s().items():
        if speed_mm_s > lever.speed_max_mm_s:
            raise BadInputError(
                f"{origin}: {key} = {speed_mm_s:g}: faster than this rig's lever.speed_max_mm_s = "
                f"{lever.speed_max_mm_s:g}; lower it"
            )
    if isinstance(protocol, WithSurface):
        speed_mm_s = protocol.surface.approach_speed_mm_s
        if speed_mm_s > lever.approach_speed_max_mm_s:
            raise BadInputError(
                f"{origin}: surface.approach_speed_mm_s = {speed_mm_s:g}: faster than this rig's "
                f"lever.approach_speed_max_mm_s = {lever.approach_speed_max_mm_s:g}; lower it"
            )
        threshold_mn = protocol.surface.contact_threshold_mn
        if threshold_mn >= lever.force_max_mn:
            raise BadInputError(
                f"{origin}: surface.contact_threshold_mn = {threshold_mn:g}: not below this rig's "
                f"lever.force_max_mn = {lever.force_max_mn:g}; lower it"
            )
    if isinstance(protocol, TrialProtocol | Study):
        for depth_mm in protocol.depths_mm():
            if depth_mm > travel_mm:
                raise BadInputError(
                    f"{origin}: depth_mm = {depth_mm:g}: beyond this rig's travel of "
                    f"{travel_mm:g} mm; lower it"
                )
            if depth_mm > lever.depth_max_mm:
                raise BadInputError(
                    f"{origin}: depth_mm = {depth_mm:g}: deeper than this rig's lever.depth_max_mm = "
                    f"{lever.depth_max_mm:g}; lower it"
                )
    for key, position_mm in protocol.positions_mm().items():
        if not lever.travel_min_mm <= position_mm <= lever.travel_max_mm:
            raise BadInputError(
                f"{origin}: {key} = {position_mm:g}: outside this rig's travel of {lever.travel_min_mm:g} to "
                f"{lever.travel_max_mm:g} mm; choose a position inside"
            )


def _read_text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise BadInputError(
            f"{path}: no such file; `indenter run --example DIR` writes examples to start from"
        ) from None
    except UnicodeDecodeError as error:
        raise BadInputError(f"{path}: not a text file in UTF-8 ({error.reason}); save it as UTF-8") from None
    except OSError as error:
        raise BadInputError(
            f"{path}: can't be read ({error.strerror}); check the path and its permissions"
        ) from None


def _parse_toml(text: str, origin: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise BadInputError(f"{origin}: not valid TOML: {error}; mend that line") from None


def _checked(adapter: TypeAdapter[T], data: dict[str, Any], origin: str) -> T:
    try:
        return adapter.validate_python(_lists_to_tuples(data))
    except ValidationError as error:
        raise BadInputError(f"{origin}: {_one_line(error, data)}") from None


def _lists_to_tuples(value: Any) -> Any:
    """TOML arrays as tuples: the models are frozen all the way down, and checked strictly."""
    if isinstance(value, Mapping):
        return {key: _lists_to_tuples(item) for key, item in value.items()}
    if isinstance(value, list):
        return tuple(_lists_to_tuples(item) for item in value)
    return value


def _one_line(error: ValidationError, data: Mapping[str, Any]) -> str:
    faults = error.errors(include_url=False)
    # an unknown key explains the missing one beside it (a wrong unit), so it is told first
    faults.sort(key=lambda fault: fault["type"] != "extra_forbidden")
    more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
    return _told(faults[0], faults, data) + more


def _told(fault: ErrorDetails, faults: list[ErrorDetails], data: Mapping[str, Any]) -> str:
    key = _key(fault, data)
    if fault["type"] == "missing":
        return f"{key}: missing; add it"
    if fault["type"] == "extra_forbidden":
        wanted = [_key(other, data).rsplit(".", 1)[-1] for other in faults if other["type"] == "missing"]
        close = get_close_matches(key.rsplit(".", 1)[-1], wanted or _known_keys(), n=1, cutoff=0.6)
        return f"{key}: unknown key; " + (f"did you mean {close[0]}?" if close else "remove it")
    if fault["type"] == "union_tag_not_found":
        return f"kind: missing; add kind = one of {', '.join(_kinds())}"
    if fault["type"] == "union_tag_invalid":
        return f"kind = {_shown(data['kind'])}: unknown; use one of {', '.join(_kinds())}"
    reason = fault["msg"].removeprefix("Value error, ").removeprefix("Input ")
    if fault["type"] == "value_error" and isinstance(fault["input"], Mapping):
        return f"{key}: {reason}" if key else reason
    return f"{key} = {_shown(fault['input'])}: {reason}; {_REMEDIES.get(fault['type'], 'change it')}"


def _key(fault: ErrorDetails, data: Mapping[str, Any]) -> str:
    """The dotted key as the file has it (the tag of the protocol's kind is no key)."""
    location = list(fault["loc"])
    if location and location[0] == data.get("kind"):
        location = location[1:]
    dotted = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location)
    return dotted.removeprefix(".")


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _kinds() -> list[str]:
    models = get_args(get_args(Protocol)[0])
    return [kind for model in models for kind in get_args(model.model_fields["kind"].annotation)]


def _known_keys() -> list[str]:
    keys: set[str] = set()
    for module in (rig_file, protocol_file):
        for thing in vars(module).values():
            if isinstance(thing, type) and issubclass(thing, BaseModel):
                keys.update(thing.model_fields)
    return sorted(keys)
