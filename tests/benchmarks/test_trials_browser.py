"""How soon a folder of trials can be browsed and overlaid. Run with `pytest -m benchmark -s` and this file."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from analysis.recordings import write_trial

pytestmark = pytest.mark.benchmark

N_FILES, N_OVERLAID, N_SAMPLES = 2000, 100, 80_000
LONG_MS = 300_000


@pytest.fixture(scope="module")
def folder(simulate: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """2,000 trials; the first 100 of 80,000 samples, the others short: a header costs the same."""
    folder = tmp_path_factory.mktemp("browsed")
    long = simulate(hold_s=N_SAMPLES / 8000)
    cut = slice(0, N_SAMPLES)
    long = replace(
        long,
        position_v=long.position_v[cut],
        force_v=long.force_v[cut],
        command_v=long.command_v[cut],
        phases=tuple(replace(p, stop=min(p.stop, N_SAMPLES)) for p in long.phases if p.start < N_SAMPLES),
    )
    short = simulate(hold_s=0.1, dwell_s=0.1)
    rng = np.random.default_rng(0)
    for i in range(N_FILES):
        trial = long if i < N_OVERLAID else short
        depth_mm = float(rng.choice([0.2, 0.4, 0.6, 0.8]))
        trial = replace(trial, trial_id=str(i), protocol=replace(trial.protocol, depth_mm=depth_mm))
        write_trial(folder / f"{i:04d}.h5", trial)
    return folder


class Gaps:
    """The longest time in which the event loop answered nothing, by a timer of 5 ms, and the longest it worked.

    On a machine that is busy with other work the first says how long the loop waited for its turn as well.
    """

    def __init__(self, qtimer: Any) -> None:
        self._timer = qtimer()
        self._timer.timeout.connect(self._tick)
        self._timer.start(5)
        self.begin()

    def __str__(self) -> str:
        return f"longest gap {1e3 * self.longest_s:.0f} ms, longest work {1e3 * self.work_s:.0f} ms"

    def begin(self) -> None:
        self.longest_s = self.work_s = 0.0
        self._last, self._worked = time.perf_counter(), time.thread_time()

    def _tick(self) -> None:
        now, worked = time.perf_counter(), time.thread_time()
        self.longest_s = max(self.longest_s, now - self._last)
        self.work_s = max(self.work_s, worked - self._worked)
        self._last, self._worked = now, worked


@pytest.fixture(scope="module")
def page(qapp: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    from rig.gui.habits import Habits
    from rig.gui.pages.trials import TrialsPage
    from rig.gui.worker import Worker

    home = tmp_path_factory.mktemp("home")
    before = os.environ.get("XDG_CACHE_HOME")
    os.environ["XDG_CACHE_HOME"] = str(home)
    worker = Worker()
    page = TrialsPage(worker, Habits(home / "window.json"))
    page.resize(1276, 690)
    page.show()
    yield page
    page.hide()
    worker.close()
    if before is None:
        del os.environ["XDG_CACHE_HOME"]
    else:
        os.environ["XDG_CACHE_HOME"] = before


def worker_cpu_s(page: Any) -> float:
    """Return the processor time that the page's worker has used, s: it says what a busy machine hides."""
    times = psutil.Process(page._worker.pids[0]).cpu_times()
    return float(times.user + times.system)


def test_a_folder_of_2000_trials(page: Any, folder: Path, qtbot: Any) -> None:
    from PySide6.QtCore import QTimer

    qtbot.waitUntil(lambda: not page._worker.busy, timeout=LONG_MS)  # warm, as in a window that is open
    gaps = Gaps(QTimer)
    for visit in ("first visit", "with the index"):
        page.table.clear()
        page.folder = None
        gaps.begin()
        worked_s = worker_cpu_s(page)
        begun = time.perf_counter()
        page.open_folder(folder)
        qtbot.waitUntil(lambda: len(page.table.rows) == N_FILES, timeout=LONG_MS)
        listed_s = time.perf_counter() - begun
        page.view.scrollToBottom()
        page.grab()
        browsable_s = time.perf_counter() - begun
        qtbot.waitUntil(lambda: all(row.header for row in page.table.rows), timeout=LONG_MS)
        read_s = time.perf_counter() - begun
        qtbot.waitUntil(lambda: not page._worker.busy, timeout=LONG_MS)
        print(
            f"\n{N_FILES} trials, {visit}: listed {listed_s:.2f} s, scrolled and painted {browsable_s:.2f} s, "
            f"every header {read_s:.2f} s, {1e3 * (worker_cpu_s(page) - worked_s) / N_FILES:.2f} ms of processor "
            f"a header; {gaps}"
        )
        assert browsable_s < 2.0
        begun = time.perf_counter()
        page._search.setText("0.40 -discarded")
        filtered_s = time.perf_counter() - begun
        begun = time.perf_counter()
        page.view.sortByColumn(2, page.view.horizontalHeader().sortIndicatorOrder().DescendingOrder)
        sorted_s = time.perf_counter() - begun
        print(f"  filter {1e3 * filtered_s:.0f} ms to {page.filter.rowCount()}, sort {1e3 * sorted_s:.0f} ms")
        page._search.setText("")
        page.view.sortByColumn(0, page.view.horizontalHeader().sortIndicatorOrder().AscendingOrder)
    assert read_s < 2.0


def test_overlay_of_100_trials(page: Any, folder: Path, qtbot: Any) -> None:
    from PySide6.QtCore import QTimer

    from rig.gui.overlay import Chosen

    qtbot.waitUntil(lambda: not page._worker.busy, timeout=LONG_MS)
    chosen = [Chosen(str(folder / f"{i:04d}.h5"), "", 0.1 * (i % 4), str(i)) for i in range(N_OVERLAID)]
    gaps = Gaps(QTimer)
    times_s = []
    for what in ("read from files", "in memory"):
        page.overlay.show_chosen([])
        qtbot.waitUntil(lambda: not page.overlay.plot.shown, timeout=LONG_MS)
        gaps.begin()
        begun = time.perf_counter()
        page.overlay.show_chosen(chosen)
        qtbot.waitUntil(lambda: len(page.overlay.plot.shown) == N_OVERLAID, timeout=LONG_MS)
        page.overlay.plot.grab()
        times_s.append(time.perf_counter() - begun)
        begun = time.perf_counter()
        page.overlay.plot.grab()
        print(
            f"\noverlay of {N_OVERLAID} trials of {N_SAMPLES} samples, {what}: {times_s[-1]:.2f} s; one repaint "
            f"{1e3 * (time.perf_counter() - begun):.0f} ms, {gaps}"
        )
    assert times_s[0] < 1.0


def test_a_fit_after_a_trial(page: Any, folder: Path, qtbot: Any) -> None:
    """From the end of a trial of 80,000 samples to its fit on the screen; also behind a diagnosis."""
    panel = page.fit_panel
    page.show_fit()
    times_s = []
    for i in range(10):
        qtbot.waitUntil(lambda: not page._worker.busy, timeout=LONG_MS)
        begun = time.perf_counter()
        with qtbot.waitSignal(panel.fitted, timeout=LONG_MS):
            panel.show_trial(folder / f"{i:04d}.h5")
        panel.grab()
        times_s.append(time.perf_counter() - begun)
    times_s.sort()
    print(
        f"\nfit of {N_SAMPLES} samples on the screen: median {times_s[5]:.2f} s, slowest {times_s[-1]:.2f} s"
    )
    assert times_s[5] < 1.0
