"""The program around the window: `indenter gui`."""

from __future__ import annotations

import signal
import sys
from pathlib import Path


def open_window(rig: Path | None) -> int:
    """Open the bench window with a rig, else the last one, else the simulated; return the exit code.

    Ctrl-C and SIGTERM close it as an answered question would: what runs is stopped, the arm taken clear.
    """
    import platformdirs
    from PySide6.QtCore import QTimer
    from PySide6.QtWidgets import QApplication

    from rig.gui.garbage import GarbageInTheEventLoop
    from rig.gui.habits import Habits
    from rig.gui.window import Window

    app = QApplication.instance() or QApplication(sys.argv[:1])
    app.setApplicationName("indenter")
    garbage = GarbageInTheEventLoop()
    habits = Habits()
    window = Window(habits, Path(platformdirs.user_log_path("indenter")))
    window.show()
    window.connect_rig(rig if rig is not None else habits.rig)
    # heard within a turn of the window's timer, and done after it
    for kind in (signal.SIGINT, signal.SIGTERM):
        signal.signal(kind, lambda *_: QTimer.singleShot(0, window.close_now))
    code = app.exec()
    # closed before Qt goes: a plot still open then brings the program down
    window.close_now()
    garbage.end()
    return code
