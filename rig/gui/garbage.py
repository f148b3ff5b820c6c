"""Garbage is collected in the window's own thread, where its widgets may be taken down, and in no other."""

from __future__ import annotations

import gc

from PySide6.QtCore import QObject, QTimer

_EVERY_MS = 200


class GarbageInTheEventLoop(QObject):
    """Turns the interpreter's own collections off, and makes them from a timer of the event loop.

    The interpreter collects in whichever thread happens to fill its count: one that reads answers or asks for
    disk space. Widgets, plots and timers in a cycle would then be destroyed outside the thread they belong to,
    which Qt forbids.
    """

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        gc.disable()
        self._timer = QTimer(self)
        self._timer.setInterval(_EVERY_MS)
        self._timer.timeout.connect(self.collect_what_is_due)
        self._timer.start()

    def collect_what_is_due(self) -> None:
        """Collect the generations whose count is above the interpreter's own threshold, youngest first."""
        for generation, most in enumerate(gc.get_threshold()):
            if gc.get_count()[generation] > most:
                gc.collect(generation)

    def end(self) -> None:
        """Leave it to the interpreter again."""
        self._timer.stop()
        gc.enable()
