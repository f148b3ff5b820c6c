"""What the header of a stranger's table says: which column is which quantity, in which unit."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence

from analysis.recordings.importers.instructions import NEEDED, QUANTITIES, factor
from analysis.recordings.importers.rows import Cell

_WORDS = {
    "time": {"time", "zeit", "elapsed", "seconds"},
    "position": {
        *("position", "displacement", "extension", "depth", "indentation", "travel", "length", "height"),
        *("stroke", "crosshead", "distance", "deformation", "weg"),
    },
    "force": {"force", "load", "kraft"},
    "command": {"command", "commanded", "setpoint", "target", "demand", "soll"},
}
_LETTERS = {"t": "time", "x": "position", "z": "position", "f": "force", "fn": "force", "fz": "force"}
_WITH_UNIT = re.compile(
    r"^(?P<name>.*?)\s*(?:\((?P<a>[^()]*)\)|\[(?P<b>[^\[\]]*)\]|/\s*(?P<c>[^/\s]+)|\bin\s+(?P<d>\S+))\s*$"
)


def split_unit(text: str) -> tuple[str, str]:
    """Return a header's name and the unit that it states in brackets, behind a slash or after "in"; else ""."""
    found = _WITH_UNIT.match(text.strip())
    if found is None:
        return text.strip(), ""
    unit = next((part for part in (found["a"], found["b"], found["c"], found["d"]) if part is not None), "")
    return found["name"].strip(), unit.strip()


def quantity_of(text: str) -> str | None:
    """Return the one quantity that a header's words name, None for none or several."""
    words = set(re.split(r"[^a-zäöüé]+", split_unit(text)[0].lower()))
    named = [quantity for quantity in QUANTITIES if words & _WORDS[quantity]]
    if "command" in named:
        return "command"
    return named[0] if len(named) == 1 else None


def named(row: Sequence[Cell]) -> dict[str, list[int]]:
    """Return quantity -> columns whose header names it; a single letter counts where no word does."""
    found: dict[str, list[int]] = {}
    letters: dict[str, list[int]] = {}
    for number, cell in enumerate(row):
        if not isinstance(cell, str):
            continue
        quantity, letter = quantity_of(cell), _LETTERS.get(split_unit(cell)[0].lower())
        if quantity is not None:
            found.setdefault(quantity, []).append(number)
        elif letter is not None:
            letters.setdefault(letter, []).append(number)
    return letters | found


def recognised(
    row: Sequence[Cell], below: Sequence[Cell] = (), units: Collection[str] = ()
) -> dict[str, int]:
    """Return quantity -> column for quantities that exactly one header of the row names, with a unit it states.

    The unit may stand in the row ``below``; that of the quantities in ``units`` is known.
    """
    found = {}
    for quantity, columns in named(row).items():
        stated = [
            column
            for column in columns
            if quantity in units or factor(quantity, stated_unit(row, below, column)) is not None
        ]
        if len(stated) == 1:
            found[quantity] = stated[0]
    return found


def stated_unit(row: Sequence[Cell], below: Sequence[Cell], column: int) -> str:
    """Return the unit that a header states, or the cell below it, as that of a row of units; else ""."""
    texts = [cells[column] if column < len(cells) else None for cells in (row, below)]
    name, under = (text.strip() if isinstance(text, str) else "" for text in texts)
    return split_unit(name)[1] or under.strip("()[] ")


def find_column(row: Sequence[Cell], wanted: str) -> int | None:
    """Return the column that ``wanted`` names, exactly or but for case and unit; None where none or several do."""
    names = [cell.strip() if isinstance(cell, str) else "" for cell in row]
    for alike in (
        lambda name: name == wanted,
        lambda name: name.lower() == wanted.lower(),
        lambda name: split_unit(name)[0].lower() == wanted.lower(),
    ):
        found = [number for number, name in enumerate(names) if name and alike(name)]
        if found:
            return found[0] if len(found) == 1 else None
    return None


def suggestion(rows: Sequence[Sequence[Cell]]) -> str:
    """Return the options that would say what this table holds, as far as its headers let it be seen."""
    best: Mapping[str, str] = {}
    units: dict[str, str] = {}
    for row in rows:
        said = {quantity: str(row[columns[0]]) for quantity, columns in named(row).items()}
        if len(said) > len(best):
            best = said
            units = {q: split_unit(text)[1] for q, text in said.items()}
    words = []
    for quantity in NEEDED:
        words.append(f"--column {quantity}={_quoted(best.get(quantity, '...'))}")
        if factor(quantity, units.get(quantity, "")) is None:
            words.append(f"--unit {quantity}=...")
    return " ".join(words)


def _quoted(text: str) -> str:
    return f"'{text}'" if re.search(r"[^\w.]", text) and text != "..." else text
