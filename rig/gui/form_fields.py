"""The fields of a protocol's form, from the protocol's own definition: units, limits, choices and help.

The help is the comment that stands with the key in the example files: one text for both.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, Literal, get_args

from rig.settings.protocol_file import Protocol

Editor = Literal["number", "whole", "text", "yes or no", "choice", "several", "numbers", "number or two"]

_UNITS = {
    "_mn_per_mm": "mN/mm",
    "_mm_s": "mm/s",
    "_m_s2": "m/s²",
    "_mm": "mm",
    "_um": "µm",
    "_mn": "mN",
    "_deg": "°",
    "_days": "days",
    "_s": "s",
    "_v": "V",
    "_g": "g",
}
_KEY = re.compile(r"^(?:# )?(?P<key>[a-z][a-z0-9_]*) = (?P<rest>.*)$")
_TABLE = re.compile(r"^\[(?P<table>[a-z_]+)\]")
_GOES_ON = re.compile(r"^\s+# (?P<words>.*)$")


@dataclass(frozen=True, slots=True)
class Field:
    """One value of a protocol: its dotted key, how it is edited, and what may stand there.

    ``limits`` in words; ``optional`` where the key may be left out for a meaning of its own.
    """

    key: str
    label: str
    unit: str
    editor: Editor
    default: Any
    required: bool
    optional: bool
    choices: tuple[str, ...]
    limits: str
    help: str

    @property
    def table(self) -> str:
        """The table of the file it stands in, empty for the top."""
        return self.key.rpartition(".")[0]

    @property
    def tip(self) -> str:
        """What the tool tip says: meaning, unit, limits, default."""
        lines = [self.help[:1].upper() + self.help[1:]] if self.help else []
        lines += [f"Allowed: {self.limits}"] if self.limits else []
        if self.default not in (None, ""):
            lines.append(f"Without the key: {shown(self.default)} {self.unit}".rstrip())
        lines.append(f"In the file: {self.key}")
        return "\n".join(lines)


def kinds() -> tuple[str, ...]:
    """Return every kind of protocol, the study first."""
    models = get_args(get_args(Protocol)[0])
    found = [kind for model in models for kind in get_args(model.model_fields["kind"].annotation)]
    return tuple(sorted(found, key=lambda kind: kind != "study"))


def example(kind: str) -> str:
    """Return the example file of a kind, every key explained."""
    return (files("rig.examples") / f"{kind}.toml").read_text(encoding="utf-8")


@cache
def fields_of(kind: str) -> tuple[Field, ...]:
    """Return the fields of a kind of protocol, in the order of the file."""
    model = next(
        model
        for model in get_args(get_args(Protocol)[0])
        if kind in get_args(model.model_fields["kind"].annotation)
    )
    schema = model.model_json_schema()
    found: list[Field] = []
    for name, stated in schema["properties"].items():
        if name == "kind":
            continue
        table = _resolved(stated, schema)
        if table.get("type") == "object":
            defaults = stated.get("default", {})
            required = table.get("required", ())
            for key, inner in table["properties"].items():
                part = {**inner, "default": defaults[key]} if key in defaults else inner
                found.append(_field(kind, f"{name}.{key}", part, schema, required=key in required))
        else:
            found.append(_field(kind, name, stated, schema, required=name in schema.get("required", ())))
    written = list(_comments(example(kind)))
    places = {key: place for place, key in enumerate(written)}
    tables = ["", *dict.fromkeys(key.rpartition(".")[0] for key in written if "." in key)]
    return tuple(
        sorted(found, key=lambda field: (tables.index(field.table), places.get(field.key, len(places))))
    )


def _field(kind: str, key: str, stated: dict[str, Any], schema: dict[str, Any], *, required: bool) -> Field:
    name = key.rpartition(".")[2]
    ending = next((ending for ending in _UNITS if name.endswith(ending)), "")
    resolved = _resolved(stated, schema)
    options = [_resolved(option, schema) for option in resolved.get("anyOf", [resolved])]
    optional = any(option.get("type") == "null" for option in options)
    options = [option for option in options if option.get("type") != "null"]
    return Field(
        key=key,
        label=name.removesuffix(ending).replace("_", " "),
        unit=_UNITS.get(ending, ""),
        editor=_editor(options),
        default=stated.get("default"),
        required=required,
        optional=optional,
        choices=_choices(options[0]),
        limits=_limits(options[0]),
        help=help_texts(kind).get(key, ""),
    )


def _resolved(stated: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any]:
    reference = stated.get("$ref")
    return schema["$defs"][reference.rpartition("/")[2]] if reference else stated


def _editor(options: list[dict[str, Any]]) -> Editor:
    first = options[0]
    simple: dict[str, Editor] = {
        "number": "number",
        "integer": "whole",
        "boolean": "yes or no",
        "string": "choice" if "enum" in first else "text",
        "array": "several" if "enum" in first.get("items", {}) else "numbers",
    }
    return "number or two" if len(options) > 1 else simple[first["type"]]


def _choices(option: dict[str, Any]) -> tuple[str, ...]:
    return tuple(option.get("enum") or option.get("items", {}).get("enum", ()))


def _limits(option: dict[str, Any]) -> str:
    each = option.get("items", option)
    words = []
    for name, text in (
        ("exclusiveMinimum", "above {:g}"),
        ("minimum", "{:g} or more"),
        ("exclusiveMaximum", "below {:g}"),
        ("maximum", "at most {:g}"),
    ):
        if name in each:
            words.append(text.format(each[name]))
    if option.get("minItems"):
        words.append(f"at least {option['minItems']} of them")
    return ", ".join(words)


@cache
def help_texts(kind: str) -> Mapping[str, str]:
    """Return what the example files say of each key; where this kind's says nothing, what the study's does."""
    found: dict[str, str] = {}
    for name in dict.fromkeys((kind, "study", "ramp_hold_retract")):
        for key, text in _comments(example(name)).items():
            if text:
                found.setdefault(key, text)
    return found


def _comments(toml: str) -> dict[str, str]:
    """Return the comment at each key, empty where there is none, in the order of the file."""
    found: dict[str, str] = {}
    table, last = "", ""
    for line in toml.splitlines():
        head, key, on = _TABLE.match(line), _KEY.match(line), _GOES_ON.match(line)
        if head:
            table, last = f"{head['table']}.", ""
        elif key:
            last = f"{table}{key['key']}"
            found[last] = key["rest"].partition(" # ")[2].strip()
        elif on and last in found:
            found[last] += " " + on["words"].strip()
        else:
            last = ""
    return {key: text.replace(" ...", "").replace("... ", "") for key, text in found.items()}


def shown(value: Any) -> str:
    """Return a value as a form shows it: numbers bare, lists with commas."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list | tuple):
        return ", ".join(shown(item) for item in value)
    return f"{value:.10g}" if isinstance(value, float) else str(value)
