"""From the Esc key in the real window to the arm moving away, while it repaints and a fit is running.

`pytest -m "slow and benchmark" -s tests/benchmarks/test_window_abort.py`; ABORTS lowers their number.
"""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ABORTS = int(os.environ.get("ABORTS", "50"))
WITHIN_MS = 100.0
AWAY_MM = 0.005
STUDY = """kind = "study"
[study]
fingers = ["index"]
depths_mm = [0.4]
repeats = 1
rest_s = 0.0
[surface]
start_mm = 2.5
approach_speed_mm_s = 0.5
[indentation]
dwell_s = 0.2
ramp_speed_mm_s = 0.5
hold_s = {hold}
"""


@pytest.mark.slow
@pytest.mark.benchmark
def test_esc_to_the_arm_moving_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, qtbot: Any, standing_bench: Any
) -> None:
    from PySide6.QtCore import Qt
    from PySide6.QtTest import QTest
    from PySide6.QtWidgets import QApplication

    from rig.engine.states import State
    from rig.gui.habits import Habits
    from rig.gui.window import Window

    monkeypatch.setenv("INDENTER_RUNTIME_DIR", str(tmp_path / "runs"))
    random = np.random.default_rng(11)
    states = (State.APPROACHING, State.RAMPING, State.HOLDING)
    keys: list[float] = []
    whens: list[State] = []
    with standing_bench(tmp_path) as bench:
        window = Window(Habits(tmp_path / "habits.json"), tmp_path / "logs")
        window.resize(1366, 768)
        window.show()
        window.connect_rig(bench.rig)

        def until(condition: Any) -> None:
            try:
                qtbot.waitUntil(lambda: bool(condition()), timeout=30_000)
            except qtbot.TimeoutError:
                pytest.fail(f"{window.link.state}\n{window.log.view.toPlainText()}")

        def idle() -> bool:
            return window.link.state.link == "open" and window.link.state.snapshot.state is State.IDLE

        def begin(name: str, hold: float) -> Path:
            protocol = tmp_path / f"{name}.toml"
            protocol.write_text(STUDY.format(hold=hold))
            assert window.study.load(protocol, tmp_path / name)
            window.link.ask("run", protocol=str(protocol), out=str(tmp_path / name), hands="bench")
            until(lambda: window.link.state.running)
            return tmp_path / name / "001_index_0.40mm_r1.h5"

        until(idle)
        whole = begin("whole", 3.0)
        until(idle)
        window.shell.show_page("Live")
        for i in range(ABORTS):
            when = states[i % len(states)]
            begin(f"abort{i}", 30.0)
            window.shell.show_page("Live")
            window.live.plot.show_span((2.0, 60.0)[i % 2])
            if i % 2:
                window.study.fit_panel.show_trial(whole)
            until(lambda when=when: window.link.state.snapshot.state is when)
            QTest.qWait(int(random.uniform(0, 250)))
            keys.append(time.time())
            whens.append(when)
            QTest.keyClick(QApplication.focusWidget() or window, Qt.Key.Key_Escape)
            until(idle)
        window.close()
        track = bench.positions()
    took = np.array([moved_away_ms(track, key) for key in keys])
    print(
        f"\nEsc to the arm {1e3 * AWAY_MM:g} um on its way back, {ABORTS} times, every other one during a fit:"
    )
    for state in states:
        some = took[[when is state for when in whens]]
        if len(some):
            print(f"  {state}: median {np.median(some):.0f} ms, maximum {some.max():.0f} ms")
    print(f"  below {WITHIN_MS:g} ms: {np.sum(took < WITHIN_MS)} of {ABORTS}")
    assert np.all(np.isfinite(took)), "an arm did not turn"


def moved_away_ms(track: np.ndarray, key: float) -> float:
    """Return when, after a key, the arm was on its way back, ms; infinity where it never was."""
    after = track[(track[:, 0] >= key) & (track[:, 0] < key + 5)]
    highest = np.maximum.accumulate(after[:, 1])
    back = np.flatnonzero(after[:, 1] < highest - AWAY_MM)
    return float(1e3 * (after[back[0], 0] - key)) if back.size else float("inf")
