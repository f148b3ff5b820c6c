from __future__ import annotations

import json
import operator
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import psutil
import pytest
from PySide6.QtCore import QObject
from pytestqt.qtbot import QtBot
from shiboken6 import delete

from analysis.recordings import read_trial
from rig.gui.worker import Worker

LONG_MS = 180_000


def test_answers_come_in_order_and_the_event_loop_goes_on(worker: Worker, qtbot: QtBot) -> None:
    got: list[Any] = []
    begun = time.perf_counter()
    worker.ask("a rest", time.sleep, 0.3, then=lambda _: got.append("rested"))
    worker.ask("a sum", operator.add, 2, 3, then=got.append)
    assert time.perf_counter() - begun < 0.1
    qtbot.waitUntil(lambda: got == ["rested", 5], timeout=LONG_MS)


def test_it_is_another_process_and_a_nice_one(worker: Worker, qtbot: QtBot) -> None:
    got: list[int] = []
    worker.ask("who", os.getpid, then=got.append)
    qtbot.waitUntil(lambda: bool(got), timeout=LONG_MS)
    assert got[0] != os.getpid()
    assert psutil.Process(got[0]).nice() == min(19, psutil.Process().nice() + 10)


def test_an_earlier_job_of_the_same_key_is_stale(worker: Worker, qtbot: QtBot) -> None:
    got: list[str] = []
    worker.ask("busy", time.sleep, 0.2, then=lambda _: got.append("under way"), key="a")
    worker.ask("old", operator.add, "o", "ld", then=got.append, key="b")
    worker.ask("other", operator.add, "ot", "her", then=got.append, key="a")
    worker.ask("new", operator.add, "n", "ew", then=got.append, key="b")
    worker.ask("last", operator.add, "la", "st", then=got.append)
    qtbot.waitUntil(lambda: "last" in got, timeout=LONG_MS)
    assert got == ["other", "new", "last"]


def test_what_is_urgent_goes_first(worker: Worker, qtbot: QtBot) -> None:
    got: list[str] = []
    worker.ask("busy", time.sleep, 0.2, then=lambda _: got.append("busy"))
    worker.ask("later", operator.add, "lat", "er", then=got.append)
    worker.ask("at once", operator.add, "at ", "once", then=got.append, urgent=True)
    qtbot.waitUntil(lambda: len(got) == 3, timeout=LONG_MS)
    assert got == ["busy", "at once", "later"]


def test_a_bad_input_and_a_fault_are_told_in_one_line(
    worker: Worker, qtbot: QtBot, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    said: list[str] = []
    worker.ask("a read", read_trial, tmp_path / "no.h5", then=pytest.fail, failed=said.append)
    worker.ask("a parse", json.loads, "{", then=pytest.fail, failed=said.append)
    qtbot.waitUntil(lambda: len(said) == 2, timeout=LONG_MS)
    assert said[0] == f"{tmp_path / 'no.h5'}: no such file: check the name"
    assert said[1].startswith("a parse failed: JSONDecodeError")


def test_a_death_is_told_and_the_next_job_is_done(qtbot: QtBot) -> None:
    worker = Worker()
    failed: list[str] = []
    got: list[int] = []
    said: list[str] = []
    worker.said.connect(said.append)
    worker.ask("dying", os._exit, 7, then=pytest.fail, failed=failed.append)
    worker.ask("a sum", operator.add, 2, 3, then=got.append)
    qtbot.waitUntil(lambda: got == [5], timeout=LONG_MS)
    assert failed == ["the worker process died (exit code 7) during: dying; it is started again"]
    assert any("died" in line for line in said)
    for pid in worker.pids:  # idle, and killed from outside
        os.kill(pid, signal.SIGKILL)
    worker.ask("another sum", operator.add, 2, 5, then=got.append, failed=failed.append)
    qtbot.waitUntil(lambda: len(got) == 2 or len(failed) == 2, timeout=LONG_MS)
    worker.ask("a third", operator.add, 4, 5, then=got.append)
    qtbot.waitUntil(lambda: got[-1] == 9, timeout=LONG_MS)
    worker.close()


def test_nobody_is_called_back_who_has_gone(worker: Worker, qtbot: QtBot) -> None:
    got: list[int] = []

    class Page(QObject):
        def ask(self) -> None:
            def shown(total: int) -> None:
                got.append(total)
                self.objectName()  # as a page would touch its widgets

            worker.ask("a sum in vain", operator.add, 2, 3, then=shown)

    page = Page()
    page.ask()
    delete(page)
    worker.ask("a sum", operator.add, 3, 4, then=got.append)
    qtbot.waitUntil(lambda: got == [7], timeout=LONG_MS)


def test_a_long_job_delays_no_other_and_can_be_ended(worker: Worker, qtbot: QtBot) -> None:
    got: list[Any] = []
    worker.ask("a diagnosis", time.sleep, 600.0, then=got.append, failed=got.append, key="long", long=True)
    worker.ask("a sum", operator.add, 2, 3, then=got.append)
    qtbot.waitUntil(lambda: got == [5], timeout=LONG_MS)
    worker.stop("long")
    worker.ask("after it", operator.add, 1, 1, then=got.append, failed=got.append, key="long", long=True)
    qtbot.waitUntil(lambda: got == [5, 2], timeout=LONG_MS)


def test_nothing_outlives_a_window_that_is_killed(tmp_path: Path) -> None:
    program = """
import sys
from PySide6.QtCore import QCoreApplication, QTimer
from rig.gui.worker import Worker
import time

if __name__ == "__main__":
    app = QCoreApplication([])
    worker = Worker()
    worker.ask("long", time.sleep, 600.0, then=print, long=True)
    QTimer.singleShot(1500, lambda: print(*worker.pids, flush=True))
    app.exec()
"""
    script = tmp_path / "window.py"
    script.write_text(program)
    window = subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True)
    assert window.stdout is not None
    pids = [int(pid) for pid in window.stdout.readline().split()]
    assert len(pids) == 2
    window.kill()
    window.wait()
    window.stdout.close()
    deadline = time.monotonic() + 20
    while any(psutil.pid_exists(pid) and _alive(pid) for pid in pids):
        assert time.monotonic() < deadline, "a worker outlives its window"
        time.sleep(0.05)


def _alive(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False
