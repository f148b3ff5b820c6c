"""Questions for a file or a folder, never in the event loop's way: the answer comes by a call.

Qt's own dialog, not the system's: that one would keep the Esc key from the arm.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from PySide6.QtWidgets import QFileDialog, QWidget


def ask_folder(parent: QWidget, title: str, start: Path | None, then: Callable[[Path], object]) -> None:
    """Ask for a folder."""
    dialog = _dialog(parent, title, start, then)
    dialog.setFileMode(QFileDialog.FileMode.Directory)
    dialog.setOption(QFileDialog.Option.ShowDirsOnly)
    dialog.open()


def ask_file(
    parent: QWidget, title: str, start: Path | None, kinds: str, then: Callable[[Path], object]
) -> None:
    """Ask for a file that exists; ``kinds`` as "Protocols (*.toml)"."""
    dialog = _dialog(parent, title, start, then)
    dialog.setFileMode(QFileDialog.FileMode.ExistingFile)
    dialog.setNameFilter(kinds)
    dialog.open()


def ask_new_file(
    parent: QWidget, title: str, proposed: Path, kinds: str, then: Callable[[Path], object]
) -> None:
    """Ask where to write a file; the dialog itself asks before one is replaced."""
    dialog = _dialog(parent, title, proposed.parent, then)
    dialog.setAcceptMode(QFileDialog.AcceptMode.AcceptSave)
    dialog.setNameFilter(kinds)
    dialog.setDefaultSuffix(proposed.suffix.removeprefix("."))
    dialog.selectFile(proposed.name)
    dialog.open()


def _dialog(parent: QWidget, title: str, start: Path | None, then: Callable[[Path], object]) -> QFileDialog:
    dialog = QFileDialog(parent, title, str(start or Path.home()))
    dialog.setOption(QFileDialog.Option.DontUseNativeDialog)
    dialog.fileSelected.connect(lambda name: then(Path(name)))
    dialog.finished.connect(dialog.deleteLater)
    return dialog
