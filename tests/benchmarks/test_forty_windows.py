"""The window opened and closed again and again in one program, every page shown: nothing of it stays.

`pytest -m benchmark -s tests/benchmarks/test_forty_windows.py`; WINDOWS gives another number.
"""

from __future__ import annotations

import gc
import os
import threading
from pathlib import Path
from typing import Any

import psutil
import pytest

WINDOWS = int(os.environ.get("WINDOWS", "40"))
_WARM = 8
"""The first ones load modules and fill caches, once."""


@pytest.mark.benchmark
def test_windows_opened_and_closed(tmp_path: Path, qtbot: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    from PySide6.QtCore import QEvent
    from PySide6.QtWidgets import QApplication

    from rig.gui.habits import Habits
    from rig.gui.window import Window

    for name in ("CONFIG", "CACHE", "STATE", "DATA"):
        monkeypatch.setenv(f"XDG_{name}_HOME", str(tmp_path / name))
    process = psutil.Process()

    def open_and_close() -> None:
        window = Window(Habits(tmp_path / "habits.json"), tmp_path / "logs")
        window.show()
        for page in window.shell.pages:
            window.shell.show_page(page)
            QApplication.processEvents()
        assert window.close()
        window.deleteLater()
        del window
        for _ in range(3):
            QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete.value)
            QApplication.processEvents()
        gc.unfreeze()  # a window sets aside what stands when it is built
        gc.collect()

    def standing() -> dict[str, float]:
        return {
            "memory MB": process.memory_info().rss / 1e6,
            "widgets": len(QApplication.allWidgets()),
            "threads": threading.active_count(),
            "processes": len(process.children(recursive=True)),
            "open files": process.num_fds(),
        }

    passed = []
    for _ in range(WINDOWS):
        open_and_close()
        passed.append(standing())
    first, last = passed[min(_WARM, WINDOWS // 2) - 1], passed[-1]
    print(f"\n{WINDOWS} windows opened and closed; from the {min(_WARM, WINDOWS // 2)}th to the last:")
    for name, now in last.items():
        print(f"  {name}: {first[name]:.0f} to {now:.0f}")
    assert last["memory MB"] - first["memory MB"] < 20.0
    for name in ("widgets", "threads", "processes", "open files"):
        assert last[name] <= first[name], name
