"""A protocol being edited: the file's own text, so that comments and order stay as its writer left them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from analysis.errors import BadInputError
from rig.gui.form_fields import Field, example, fields_of, kinds
from rig.settings.reading import check_protocol_on_rig, parse_protocol, protocol_faults
from rig.settings.rig_file import RigFile


class ProtocolDraft:
    """One protocol file in memory; ``path`` is None until it has one.

    Raises BadInputError for a text that is not TOML, or of no known kind; faulty values are kept and told by
    `faults`.
    """

    def __init__(self, text: str, path: Path | None) -> None:
        where = str(path) if path else "the protocol"
        try:
            self._document = tomlkit.parse(text)
        except TOMLKitError as error:
            raise BadInputError(f"{where}: not valid TOML: {error}; mend that line") from None
        kind = self._document.get("kind")
        if kind not in kinds():
            raise BadInputError(f"{where}: kind = {kind!r}: unknown; use one of {', '.join(kinds())}")
        self.kind = str(kind)
        self.path = path
        self._saved = text if path is not None else self.text

    @classmethod
    def example(cls, kind: str) -> ProtocolDraft:
        """Return the example of a kind, every key explained."""
        return cls(example(kind), None)

    @classmethod
    def load(cls, path: Path) -> ProtocolDraft:
        """Read a file; BadInputError where it can't be."""
        try:
            return cls(path.read_text(encoding="utf-8"), path.absolute())
        except UnicodeDecodeError as error:
            raise BadInputError(f"{path}: not a text in UTF-8 ({error.reason}); save it as UTF-8") from None
        except OSError as error:
            raise BadInputError(f"{path}: can't be read ({error.strerror}); check the path") from None

    @property
    def text(self) -> str:
        """The file as it would be saved."""
        return tomlkit.dumps(self._document)

    @property
    def changed(self) -> bool:
        """Whether it differs from the file, or from the example it began as."""
        return self.text != self._saved

    @property
    def fields(self) -> tuple[Field, ...]:
        """What can be edited."""
        return fields_of(self.kind)

    def value(self, field: Field) -> Any:
        """Return what the file says, None where it does not state the key."""
        table: Any = self._document
        for part in field.key.split("."):
            if not isinstance(table, Mapping) or part not in table:
                return None
            table = table[part]
        return table.unwrap() if hasattr(table, "unwrap") else table

    def put(self, field: Field, value: Any) -> None:
        """State a value; None takes the key out, an unchanged value leaves the file's own writing."""
        before = self.value(field)
        if value == before and type(value) is type(before):
            return
        table: Any = self._document
        if field.table:
            if field.table not in table:
                if value is None:
                    return
                table.add(field.table, tomlkit.table())
            table = table[field.table]
        name = field.key.rpartition(".")[2]
        if value is None:
            table.pop(name, None)
        else:
            table[name] = value

    def faults(self, rig: RigFile | None) -> dict[str, str]:
        """Return what is wrong, by dotted key ("" where no key is named): with the values, then on the rig."""
        found = protocol_faults(self._document.unwrap())
        if found or rig is None:
            return found
        try:
            check_protocol_on_rig(parse_protocol(self.text, ""), rig, "")
        except BadInputError as error:
            text = str(error).removeprefix(": ")
            return {text.partition(" = ")[0]: text}
        return {}

    def save(self, path: Path) -> None:
        """Write the file, whole or not at all. Raises BadInputError where it can't be written."""
        part = path.with_name(f".{path.name}.{os.getpid()}.part")
        try:
            part.write_text(self.text, encoding="utf-8")
            part.replace(path)
        except OSError as error:
            raise BadInputError(f"{path}: can't be written ({error.strerror}); save it elsewhere") from None
        self.path = path.absolute()
        self._saved = self.text


def fault_of(field: Field, faults: Mapping[str, str]) -> str:
    """Return what is wrong with a field, without its own name before it; empty where nothing is."""
    name = field.key.rpartition(".")[2]
    for key, text in faults.items():
        own = key == field.key or key.startswith((f"{field.key}[", f"{field.key}."))
        # a rule between several values names the first of them
        of_table = key == field.table and text.removeprefix(f"{key}: ").startswith(name)
        if own or of_table or key == name:
            return text.partition(": ")[2] if own or key == name else text.removeprefix(f"{key}: ")
    return ""
