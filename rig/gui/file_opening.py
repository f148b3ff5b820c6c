"""Single files opened beside a folder's: trial files as they are, other programs' recordings imported first."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from rig.gui.jobs.exporting import bring_in
from rig.gui.jobs.headers import read_headers
from rig.gui.worker import Worker

_IMPORTED = "imported"


class FileOpening(QObject):
    """Reads files in the worker. `headers` gives what they say of themselves, `failed` why one can't be had."""

    headers = Signal(object)
    failed = Signal(str)
    said = Signal(str)

    def __init__(self, worker: Worker, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._worker = worker

    def open(self, paths: Sequence[Path], folder: Path | None) -> None:
        """Open files; imports go into the subfolder "imported" of ``folder``, or of where the file lies."""
        self._read([str(path.absolute()) for path in paths if path.suffix.lower() == ".h5"])
        for path in paths:
            if path.suffix.lower() != ".h5":
                self._worker.ask(
                    f"the import of {path.name}",
                    bring_in,
                    path.absolute(),
                    (folder or path.absolute().parent) / _IMPORTED,
                    then=partial(self._imported, path),
                    failed=self.failed.emit,
                )

    def _imported(self, source: Path, made: Sequence[str]) -> None:
        self.said.emit(f"{source.name}: imported as {', '.join(made)}")
        self._read(list(made))

    def _read(self, paths: list[str]) -> None:
        if paths:
            then, failed = self.headers.emit, self.failed.emit
            self._worker.ask("reading trial files", read_headers, paths, then=then, failed=failed)
