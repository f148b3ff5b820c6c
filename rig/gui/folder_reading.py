"""A folder of trials, read in the worker a piece at a time while its names are shown already."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from rig.gui.jobs.headers import BEING_WRITTEN, Header, Listing, keep_index, list_folder, read_first_headers
from rig.gui.worker import Worker

_FIRST, _AT_A_TIME = 16, 512
_AT_A_TIME_S = 0.2
"""What is urgent, the fit of a trial that has just ended, waits no longer for the worker than this."""

_KEY = "folder of trials"


class FolderReading(QObject):
    """Lists a folder and reads the headers that its index does not know.

    `listed` comes first and once; then `headers` again and again; `done` at the end. A file on which the
    reading process dies is found by halving, and told as unreadable: the others are read all the same.
    """

    listed = Signal(object)
    headers = Signal(object)
    done = Signal()
    failed = Signal(str)

    def __init__(self, worker: Worker, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._worker = worker
        self._folder: Path | None = None
        self._found: dict[str, Header] = {}
        self._waiting: list[list[str]] = []

    @property
    def progress(self) -> tuple[int, int]:
        """Headers read, and files in all."""
        waiting = sum(len(chunk) for chunk in self._waiting)
        return len(self._found), len(self._found) + waiting

    def read(self, folder: Path) -> None:
        """List a folder, or look for what has changed in it; an earlier reading is given up."""
        self._folder = folder
        self._found, self._waiting = {}, []
        self._worker.ask(
            f"the list of {folder.name}",
            list_folder,
            folder,
            then=self._listed,
            failed=self.failed.emit,
            key=_KEY,
            urgent=True,
        )

    def learned(self, headers: Sequence[Header]) -> None:
        """Take headers that were read elsewhere into the index."""
        self._found |= {header.path: header for header in headers}
        if not self._waiting:
            self._keep()

    def _listed(self, listing: Listing) -> None:
        self._found = {header.path: header for header in listing.known}
        unread = list(listing.unread)
        self._waiting = [unread[:_FIRST]] if unread else []
        self._waiting += [unread[i : i + _AT_A_TIME] for i in range(_FIRST, len(unread), _AT_A_TIME)]
        self.listed.emit(listing)
        self._next(changed=False)

    def _next(self, *, changed: bool = True) -> None:
        if not self._waiting:
            if changed:
                self._keep()
            self.done.emit()
            return
        chunk = self._waiting[0]
        self._worker.ask(
            "reading trial files",
            read_first_headers,
            chunk,
            _AT_A_TIME_S,
            then=self._read,
            failed=partial(self._not_read, chunk),
            key=_KEY,
        )

    def _read(self, headers: Sequence[Header]) -> None:
        self._waiting[0] = self._waiting[0][len(headers) :]
        if not self._waiting[0]:
            self._waiting.pop(0)
        self._found |= {header.path: header for header in headers}
        more = bool(self._waiting)
        if more:
            self._next()  # first: the worker reads on while these are shown
        self.headers.emit(headers)
        if not more:
            self._next()

    def _not_read(self, chunk: list[str], problem: str) -> None:
        """Halve a chunk on which the process died, until the file that does it stands alone."""
        if len(chunk) > 1:
            half = len(chunk) // 2
            self._waiting[0:1] = [chunk[:half], chunk[half:]]
            self._next()
        else:
            self._read([Header(chunk[0], 0, 0, problem=problem)])

    def _keep(self) -> None:
        assert self._folder is not None
        known = [header for header in self._found.values() if header.size and header.problem != BEING_WRITTEN]
        self._worker.ask("keeping the index", keep_index, self._folder, known, then=lambda _: None)
