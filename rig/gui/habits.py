"""What the window remembers from one day to the next: layout, folders, the last rig, recent protocols."""

from __future__ import annotations

import base64
import binascii
import json
import os
from pathlib import Path
from typing import Any

_MOST_RECENT = 12


class Habits:
    """A small file of the user's; one that can't be read is begun anew, one that can't be written is said.

    `fault` is the one line that says why the last change was not kept, empty where it was.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._path = path or _default_path()
        self._values = _read(self._path)
        self.fault = ""

    @property
    def theme(self) -> str:
        """Name of the look, "light" without a choice."""
        return self._text("theme") or "light"

    @theme.setter
    def theme(self, name: str) -> None:
        self._put("theme", name)

    @property
    def rig(self) -> Path | None:
        """The rig file used last; None: the simulated rig."""
        text = self._text("rig")
        return Path(text) if text else None

    @rig.setter
    def rig(self, path: Path | None) -> None:
        self._put("rig", "" if path is None else str(path.absolute()))

    @property
    def recent_protocols(self) -> tuple[Path, ...]:
        """Protocol files used lately, the last one first."""
        listed = self._values.get("recent_protocols")
        return tuple(Path(p) for p in listed if isinstance(p, str)) if isinstance(listed, list) else ()

    def used_protocol(self, path: Path) -> None:
        """Put a protocol file at the head of the recent ones."""
        used = path.absolute()
        others = [p for p in self.recent_protocols if p != used]
        self._put("recent_protocols", [str(p) for p in (used, *others)][:_MOST_RECENT])

    def folder(self, purpose: str) -> Path | None:
        """Return the folder used last for a purpose (trials, protocols, export, ...)."""
        text = self._table("folders").get(purpose)
        return Path(text) if isinstance(text, str) else None

    def used_folder(self, purpose: str, path: Path) -> None:
        """Remember the folder of a purpose."""
        self._put("folders", {**self._table("folders"), purpose: str(path.absolute())})

    def layout(self, name: str) -> bytes | None:
        """Return what `saveState` or `saveGeometry` of a widget gave; None where nothing is kept."""
        text = self._table("layouts").get(name)
        try:
            return base64.b64decode(text, validate=True) if isinstance(text, str) else None
        except binascii.Error:
            return None

    def keep_layout(self, name: str, state: bytes) -> None:
        """Remember a widget's `saveState` or `saveGeometry`."""
        self._put("layouts", {**self._table("layouts"), name: base64.b64encode(state).decode()})

    def forget_layouts(self) -> None:
        """Go back to the layout the window comes with."""
        self._put("layouts", {})

    def choice(self, name: str, default: str) -> str:
        """Return a page's remembered choice, as of an axis or a model."""
        value = self._table("choices").get(name)
        return value if isinstance(value, str) else default

    def keep_choice(self, name: str, value: str) -> None:
        """Remember a page's choice."""
        if self.choice(name, "") != value:
            self._put("choices", {**self._table("choices"), name: value})

    def _text(self, name: str) -> str:
        value = self._values.get(name)
        return value if isinstance(value, str) else ""

    def _table(self, name: str) -> dict[str, Any]:
        value = self._values.get(name)
        return value if isinstance(value, dict) else {}

    def _put(self, name: str, value: Any) -> None:
        self._values[name] = value
        part = self._path.with_name(f"{self._path.name}.{os.getpid()}.part")
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            part.write_text(json.dumps(self._values, indent=1), encoding="utf-8")
            part.replace(self._path)
            self.fault = ""
        except OSError as error:
            self.fault = f"{self._path}: can't be written ({error.strerror}): the window will forget this"


def _default_path() -> Path:
    import platformdirs

    return platformdirs.user_config_path("indenter") / "window.json"


def _read(path: Path) -> dict[str, Any]:
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return values if isinstance(values, dict) else {}
