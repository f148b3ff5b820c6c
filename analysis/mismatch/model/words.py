"""Names as they are spoken."""

from __future__ import annotations

from collections.abc import Sequence


def spoken(name: str) -> str:
    """Return a mechanism's name as it is spoken."""
    return name.replace("_", " ")


def listed(items: Sequence[str], last: str = "and") -> str:
    """Join words as a sentence does."""
    if len(items) < 2:
        return "".join(items)
    return f"{', '.join(items[:-1])} {last} {items[-1]}"
