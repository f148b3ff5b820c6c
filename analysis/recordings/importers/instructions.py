"""What a user says of recordings that don't say it themselves: columns, units, signs, specimen, protocol.

Said on the command line, or in a mapping file (TOML) for a whole folder:

    [columns]                       # quantity = the column's name, or its number from 1
    time = "Zeit"
    position = "Weg"
    force = "Kraft"
    command = "Soll"                # optional
    [units]                         # needed where the header does not state them; a minus turns the sign
    time = "s"
    position = "um"
    force = "-N"
    [specimen]
    finger = "index"
    punch_diameter_mm = 0.5
    [protocol]
    depth_mm = 0.4
    ramp_speed_mm_s = 5.0
    [[trials]]                      # a wide table: several trials side by side
    name = "first"
    force = "Kraft 1"
    [files."b.xlsx".specimen]       # what differs in one file
    finger = "thumb"
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from analysis.errors import BadInputError
from analysis.recordings.layout import attributes_of

QUANTITIES = ("time", "position", "force", "command")
NEEDED = ("time", "position", "force")

# factors to seconds, millimetres and millinewtons
_LENGTHS = {"nm": 1e-6, "um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1e3, "in": 25.4}
_FORCES = {"pn": 1e-9, "nn": 1e-6, "un": 1e-3, "mn": 1.0, "n": 1e3, "kn": 1e6, "gf": 9.80665, "kgf": 9806.65}
UNITS: dict[str, dict[str, float]] = {
    "time": {"us": 1e-6, "ms": 1e-3, "s": 1.0, "sec": 1.0, "min": 60.0, "h": 3600.0},
    "position": _LENGTHS,
    "force": _FORCES,
    "command": _LENGTHS,
}


@dataclass(frozen=True, slots=True)
class Instructions:
    """What is said of the files of one import.

    ``columns`` quantity -> name or number of a column; ``units`` quantity -> unit, with a minus where the
    sign is to be turned; ``specimen`` and ``protocol`` attributes of those groups of the trial file; ``trials``
    the columns and names of the trials of a wide table; ``files`` what differs, by file name; ``sheet`` of a
    spreadsheet.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    specimen: Mapping[str, Any] = field(default_factory=dict)
    protocol: Mapping[str, Any] = field(default_factory=dict)
    trials: tuple[Mapping[str, Any], ...] = ()
    files: Mapping[str, Instructions] = field(default_factory=dict)
    sheet: str = ""

    @property
    def of_columns(self) -> bool:
        """Whether anything is said of columns and units."""
        return bool(self.columns or self.units or self.trials or self.sheet)

    def on(self, file: Path) -> Instructions:
        """Return what holds for one file: what is said of all, and over it what is said of that one."""
        own = self.files.get(file.name)
        return self if own is None else self.over(own)

    def over(self, other: Instructions) -> Instructions:
        """Return these instructions, replaced where ``other`` says something."""
        return replace(
            self,
            columns={**self.columns, **other.columns},
            units={**self.units, **other.units},
            specimen={**self.specimen, **other.specimen},
            protocol={**self.protocol, **other.protocol},
            trials=other.trials or self.trials,
            files={**self.files, **other.files},
            sheet=other.sheet or self.sheet,
        )


NOTHING_SAID = Instructions()


def factor(quantity: str, unit: str) -> float | None:
    """Return what turns a unit into s, mm or mN, negative for one with a minus; None where it is not known."""
    text = unit.strip().replace("µ", "u").replace("μ", "u")
    sign = -1.0 if text.startswith("-") else 1.0
    size = UNITS[quantity].get(text.removeprefix("-").strip().lower())
    # MN, meganewton, is not to be taken for mN
    return None if size is None or re.fullmatch(r"-?\s*M[a-zA-Z]", text) else sign * size


def said_on_command_line(
    columns: Sequence[str] = (), units: Sequence[str] = (), sheet: str | None = None, **known: Any
) -> Instructions:
    """Return the instructions of options: ``columns`` and ``units`` as quantity=text, ``known`` attributes."""
    specimen_names = {attribute.name for attribute in attributes_of("/specimen")}
    said = {name: value for name, value in known.items() if value is not None}
    return Instructions(
        columns=_pairs("--column", columns),
        units=_checked_units("--unit", _pairs("--unit", units)),
        specimen=_checked("--", "/specimen", {n: v for n, v in said.items() if n in specimen_names}),
        protocol=_checked("--", "/protocol", {n: v for n, v in said.items() if n not in specimen_names}),
        sheet=sheet or "",
    )


def read_mapping(path: Path) -> Instructions:
    """Read a mapping file. Raises BadInputError with the key that is wrong."""
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInputError(f"{path}: can't be read ({error.strerror}): check the name") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInputError(f"{path}: is no TOML ({error}): mend it") from error
    return _of_document(str(path), document)


def _of_document(where: str, document: Mapping[str, Any]) -> Instructions:
    known = {"columns", "units", "specimen", "protocol", "trials", "files", "sheet"}
    strange = sorted(set(document) - known)
    if strange:
        raise BadInputError(f"{where}: {strange[0]!r} is not known: known are {', '.join(sorted(known))}")
    for name in known - {"trials", "sheet"}:
        if not isinstance(document.get(name, {}), dict):
            raise BadInputError(f"{where}: {name} must be a table: write [{name}] above its keys")
    trials = document.get("trials", [])
    if not isinstance(trials, list) or not all(isinstance(one, dict) for one in trials):
        raise BadInputError(f"{where}: trials must be a list of tables: write [[trials]] above each")
    for one in trials:
        strange = sorted(set(one) - {"name", "specimen", "protocol", *QUANTITIES})
        if strange:
            raise BadInputError(
                f"{where}: [[trials]] has {strange[0]!r}: known are name, specimen, protocol, {', '.join(QUANTITIES)}"
            )
    return Instructions(
        columns={name: str(text) for name, text in _quantities(where, document.get("columns", {})).items()},
        units=_checked_units(where, _quantities(where, document.get("units", {}))),
        specimen=_checked(where, "/specimen", document.get("specimen", {})),
        protocol=_checked(where, "/protocol", document.get("protocol", {})),
        trials=tuple(trials),
        files={
            name: _of_document(f"{where}: files.{name}", own)
            for name, own in document.get("files", {}).items()
        },
        sheet=str(document.get("sheet", "")),
    )


def _pairs(option: str, texts: Sequence[str]) -> dict[str, str]:
    pairs = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not value.strip():
            raise BadInputError(f"{option} {text}: write it as QUANTITY=TEXT, as in {option} force=...")
        pairs[name.strip()] = value.strip()
    return _quantities(option, pairs)


def _quantities(where: str, pairs: Mapping[str, Any]) -> dict[str, Any]:
    for name in pairs:
        if name not in QUANTITIES:
            raise BadInputError(f"{where}: {name!r} is no quantity: use {', '.join(QUANTITIES)}")
    return dict(pairs)


def _checked_units(where: str, units: Mapping[str, Any]) -> dict[str, str]:
    for quantity, unit in units.items():
        if factor(quantity, str(unit)) is None:
            known = ", ".join(
                name.replace("n", "N") if quantity == "force" else name for name in UNITS[quantity]
            )
            raise BadInputError(f"{where}: {quantity} in {unit!r} is not known: use one of {known}")
    return {quantity: str(unit) for quantity, unit in units.items()}


def _checked(where: str, group: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return attributes of a group, each of its type and checked as the trial file checks it."""
    declared = {attribute.name: attribute for attribute in attributes_of(group)}
    checked = {}
    for name, value in values.items():
        attribute = declared.get(name)
        if attribute is None:
            raise BadInputError(f"{where}: {name!r} is not known: use one of {', '.join(declared)}")
        whole = attribute.type is int and isinstance(value, float)
        if (
            isinstance(value, bool)
            or whole
            or not isinstance(value, (str,) if attribute.type is str else (int, float))
        ):
            raise BadInputError(
                f"{where}: {name} is {value!r}: {attribute.meaning} is a {attribute.type.__name__}"
            )
        converted = attribute.type(value)
        wrong = attribute.check(converted) if attribute.check else None
        if wrong:
            raise BadInputError(f"{where}: {name} is {value!r}: it {wrong}")
        checked[name] = converted
    return checked
