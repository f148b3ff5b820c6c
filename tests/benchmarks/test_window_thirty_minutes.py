"""Thirty minutes at 8 kHz with the live view on and a trial being written: samples, frames, gaps, memory.

`pytest -m "slow and benchmark" -s tests/benchmarks/test_window_thirty_minutes.py`; MINUTES shortens it.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from analysis.recordings import read_trial

MINUTES = float(os.environ.get("MINUTES", "30"))
PROTOCOL = """kind = "ramp_hold_retract"
[surface]
start_mm = 2.5
[indentation]
depth_mm = 0.4
dwell_s = 0.5
hold_s = {hold}
"""


@pytest.mark.slow
@pytest.mark.benchmark
def test_live_view_for_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, qtbot: Any, real_time_rig: str
) -> None:
    from PySide6.QtCore import Qt, QTimer

    from rig.engine.states import State
    from rig.gui.habits import Habits
    from rig.gui.window import Window

    monkeypatch.setenv("INDENTER_RUNTIME_DIR", str(tmp_path / "runs"))
    (tmp_path / "rig.toml").write_text(real_time_rig)
    (tmp_path / "long.toml").write_text(PROTOCOL.format(hold=60 * MINUTES))
    window = Window(Habits(tmp_path / "habits.json"), tmp_path / "logs")
    window.resize(1366, 768)
    window.show()
    window.connect_rig(tmp_path / "rig.toml")

    def state() -> State:
        return window.link.state.snapshot.state

    qtbot.waitUntil(lambda: window.link.state.link == "open" and state() is State.IDLE, timeout=90_000)
    assert window.study.load(tmp_path / "long.toml", tmp_path / "out")
    window.study.by_bench.setChecked(True)
    window.commands.start()
    window.shell.show_page("Live")
    qtbot.waitUntil(lambda: state() is State.HOLDING, timeout=90_000)

    frames: list[float] = []
    gaps: list[float] = []
    memory: list[float] = []
    process, last = psutil.Process(), [time.monotonic()]

    def tick() -> None:
        now = time.monotonic()
        gaps.append(now - last[0])
        last[0] = now

    paint = window.live.refresh
    window.live.refresh = lambda: (paint(), frames.append(time.monotonic()))  # type: ignore[method-assign]
    pulse = QTimer()
    pulse.setTimerType(Qt.TimerType.PreciseTimer)
    pulse.setInterval(10)
    pulse.timeout.connect(tick)
    last[0] = time.monotonic()
    pulse.start()
    began = time.monotonic()
    spans = iter([1.0, 10.0, 60.0, 300.0, 0.0] * 10_000)
    while state() is State.HOLDING:
        window.live.plot.show_span(next(spans))
        until = time.monotonic() + min(10.0, 6 * MINUTES)
        qtbot.waitUntil(
            lambda until=until: time.monotonic() > until or state() is not State.HOLDING, timeout=60_000
        )
        memory.append(process.memory_info().rss / 1e6)
    pulse.stop()
    lasted = time.monotonic() - began
    qtbot.waitUntil(lambda: state() is State.IDLE, timeout=90_000)
    lost, missed = window.link.state.snapshot.n_lost, window.link.bins.n_missed if window.link.bins else -1
    window.close()
    trial = read_trial(tmp_path / "out" / "index_0.40mm.h5")
    per_second = np.histogram(np.array(frames) - began, bins=np.arange(0, lasted, 1.0))[0]
    longest = 1e3 * np.array(gaps)
    settled = memory[len(memory) // 5 :]
    print(
        f"\n{lasted / 60:.1f} min at 8 kHz, 3 channels, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors\n"
        f"samples lost {lost}, not seen by the live view {missed}; file {trial.status}, {trial.n_samples} samples\n"
        f"frames a second: median {np.median(per_second):.0f}, 5 % {np.quantile(per_second, 0.05):.0f}\n"
        f"event loop: longest gap {longest.max():.0f} ms, 99.9 % {np.quantile(longest, 0.999):.0f} ms, "
        f"above 100 ms {np.sum(longest > 100)} of {len(longest)}\n"
        f"memory: {settled[0]:.0f} MB after a fifth, {settled[-1]:.0f} MB at the end ({settled[-1] - settled[0]:+.1f})"
    )
    assert lost == 0
    assert trial.status == "complete"
