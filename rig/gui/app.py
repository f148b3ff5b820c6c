"""The program around the window: `indenter gui`."""

from __future__ import annotations

import sys
from pathlib import Path


def open_window(rig: Path | None, *, simulated: bool = False) -> int:
    """Open the bench window with a rig, else the last one, else the simulated; return the exit code."""
    import platformdirs
    from PySide6.QtWidgets import QApplication

    from rig.gui.habits import Habits
    from rig.gui.window import Window

    app = QApplication.instance() or QApplication(sys.argv[:1])
    app.setApplicationName("indenter")
    habits = Habits()
    window = Window(habits, Path(platformdirs.user_log_path("indenter")))
    window.show()
    window.connect_rig(rig if rig is not None or simulated else habits.rig)
    code = app.exec()
    # the window goes before Qt does: a plot that outlives it brings the program down
    del window
    return code
