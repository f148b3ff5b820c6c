"""Qt's objects that are left in a cycle are destroyed in the window's thread, whichever thread is busy."""

from __future__ import annotations

import gc
import threading
import weakref
from collections.abc import Iterator
from typing import Any

import pytest
from PySide6.QtCore import QObject

from rig.gui.garbage import GarbageInTheEventLoop


@pytest.fixture
def garbage(qapp: Any) -> Iterator[GarbageInTheEventLoop]:
    garbage = GarbageInTheEventLoop()
    yield garbage
    garbage.end()


def fill_the_count() -> None:
    """Make as much cyclic garbage as the interpreter collects for, many times over."""
    for _ in range(200_000):
        cycle: list[Any] = []
        cycle.append(cycle)


def test_it_is_collected_by_the_event_loop_and_by_no_other_thread(
    garbage: GarbageInTheEventLoop, qtbot: Any
) -> None:
    ended_in: list[int] = []

    class Held:
        pass

    widget, held = QObject(), Held()
    widget.held, held.widget = held, widget  # type: ignore[attr-defined]
    weakref.finalize(held, lambda: ended_in.append(threading.get_ident()))
    del widget, held
    other = threading.Thread(target=fill_the_count)
    other.start()
    other.join()
    assert not ended_in
    assert gc.get_count()[0] > gc.get_threshold()[0]
    qtbot.waitUntil(lambda: bool(ended_in))
    assert ended_in == [threading.get_ident()]


def test_the_interpreter_collects_again_afterwards(qapp: Any) -> None:
    garbage = GarbageInTheEventLoop()
    assert not gc.isenabled()
    garbage.end()
    assert gc.isenabled()
