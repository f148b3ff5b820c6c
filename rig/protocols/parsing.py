"""From the text of a protocol file to a protocol, or to one line that says what is wrong with it."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, get_args

from pydantic import BaseModel, Field, TypeAdapter, ValidationError

from analysis.errors import BadInputError
from rig.protocols.settings import Protocol

_ADAPTER: TypeAdapter[Protocol] = TypeAdapter(Annotated[Protocol, Field(discriminator="kind")])
MODELS: dict[str, type[BaseModel]] = {
    get_args(model.model_fields["kind"].annotation)[0]: model for model in get_args(Protocol)
}


def parse_protocol(text: str, source: str) -> Protocol:
    """Return the protocol that the TOML `text` describes.

    `source` names the file in messages. Raises BadInputError, in one line, where the text is no TOML, a
    key is missing, unknown, of the wrong type or out of range.
    """
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise BadInputError(f"{source}: not valid TOML: {error}") from error
    kind = table.get("kind")
    if not isinstance(kind, str) or kind not in MODELS:
        said = "kind is missing" if kind is None else f"kind = {kind!r:.40} is unknown"
        raise BadInputError(f"{source}: {said}: use one of {', '.join(sorted(MODELS))}")
    try:
        return _ADAPTER.validate_python(table)
    except ValidationError as error:
        raise BadInputError(f"{source}: {_one_line(error, kind)}") from error


def _one_line(error: ValidationError, kind: str) -> str:
    """Say the first fault in words, and how many more there are."""
    faults = error.errors()
    first = faults[0]
    path = [part for part in first["loc"] if part != kind]
    more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
    return f"{_fault(first, path, MODELS[kind])}{more}"


def _fault(fault: Mapping[str, Any], path: list[int | str], model: type[BaseModel]) -> str:
    where = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in path).lstrip(".") or "the file"
    if fault["type"] == "extra_forbidden":
        known = _keys_at(model, path[:-1])
        close = difflib.get_close_matches(str(path[-1]), known, n=1, cutoff=0.5)
        hint = f"did you mean {close[0]}?" if close else f"known keys: {', '.join(known)}"
        return f"{where} is not a key of this protocol: {hint}"
    if fault["type"] == "missing":
        return f"{where} is missing: add it (see `indenter run --example DIR` for every key)"
    said = str(fault["msg"]).removeprefix("Value error, ").replace("\n", " ")
    given = "" if isinstance(fault["input"], Mapping) else f", not {fault['input']!r:.60}"
    return f"{where}: {said[:1].lower()}{said[1:]}{given}"


def _keys_at(model: type[BaseModel], path: Iterable[int | str]) -> list[str]:
    """Return the keys that the table at `path` of a model knows."""
    for part in path:
        field = model.model_fields.get(str(part))
        if field is None or not isinstance(field.annotation, type):
            return []
        if not issubclass(field.annotation, BaseModel):
            return []
        model = field.annotation
    return list(model.model_fields)
