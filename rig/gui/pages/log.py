"""Everything that was asked, done and said, in order; the same lines go to a file."""

from __future__ import annotations

import logging
from datetime import datetime
from html import escape
from logging.handlers import RotatingFileHandler
from pathlib import Path

from PySide6.QtWidgets import QPlainTextEdit, QVBoxLayout, QWidget

from rig.gui.controls import words
from rig.gui.theme import LIGHT, Theme

_MOST_LINES = 5000
_FILE_BYTES = 2_000_000


class LogPage(QWidget):
    """The lines of this window, and the file that keeps those of earlier ones too."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._theme = LIGHT
        self._log = logging.Logger("window")
        self._handler: logging.Handler = logging.NullHandler()
        where = f"The same lines are kept in {path}"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._handler = RotatingFileHandler(path, maxBytes=_FILE_BYTES, backupCount=3, encoding="utf-8")
        except OSError as error:
            where = f"{path} can't be written ({error.strerror}): the lines are kept in this window only"
        self._handler.setFormatter(logging.Formatter("%(asctime)s %(message)s"))
        self._log.addHandler(self._handler)
        self.view = QPlainTextEdit()
        self.view.setReadOnly(True)
        self.view.setMaximumBlockCount(_MOST_LINES)
        self.view.setAccessibleName("log")
        layout = QVBoxLayout(self)
        layout.addWidget(words(where, "faint"))
        layout.addWidget(self.view)

    def add(self, line: str, kind: str = "") -> None:
        """Add a line; `kind` is one of the looks of words (good, note, bad)."""
        self._log.info("%s%s", f"{kind}: " if kind else "", line)
        colours = {
            "good": self._theme.good,
            "done": self._theme.good,
            "note": self._theme.note,
            "bad": self._theme.bad,
        }
        text = f"{datetime.now():%H:%M:%S}  {escape(line)}"
        colour = colours.get(kind, self._theme.text)
        self.view.appendHtml(f'<span style="color:{colour}">{text}</span>')

    def close_file(self) -> None:
        """Close the file."""
        self._handler.close()

    def restyle(self, theme: Theme) -> None:
        """Take the theme's colours, for the lines to come."""
        self._theme = theme
