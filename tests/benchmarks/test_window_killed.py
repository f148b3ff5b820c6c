"""The window is killed at random moments of a run: the runner ends, the file is kept, the arm is clear.

`pytest -m "slow and benchmark" -s tests/benchmarks/test_window_killed.py`; WINDOW_KILLS lowers their number.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

from analysis.recordings import read_trial
from rig.engine.announcing import announcements

KILLS = int(os.environ.get("WINDOW_KILLS", "50"))
SAFE_MM = 0.5
STUDY = """kind = "study"
[study]
fingers = ["index"]
depths_mm = [0.4]
repeats = 1
rest_s = 0.0
[surface]
start_mm = 2.5
[indentation]
dwell_s = 0.3
hold_s = 3.0
"""
WINDOW = """
import sys
from pathlib import Path
if __name__ == "__main__":
    from PySide6.QtCore import QTimer
    from PySide6.QtWidgets import QApplication
    from rig.gui.habits import Habits
    from rig.gui.window import Window
    folder, rig, protocol, out = map(Path, sys.argv[1:])
    app = QApplication([])
    window = Window(Habits(folder / "habits.json"), folder / "logs")
    window.show()
    def begin():
        window.study.load(protocol, out)
        window.link.ask("run", protocol=str(protocol), out=str(out), hands="bench")
    window.link.opened.connect(lambda: QTimer.singleShot(0, begin))
    window.connect_rig(rig)
    app.exec()
"""


@pytest.mark.slow
@pytest.mark.benchmark
def test_the_window_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, standing_bench: Any) -> None:
    monkeypatch.setenv("INDENTER_RUNTIME_DIR", str(tmp_path / "runs"))
    random = np.random.default_rng(7)
    script, protocol = tmp_path / "window.py", tmp_path / "one.toml"
    script.write_text(WINDOW)
    protocol.write_text(STUDY)
    rings = set(Path("/dev/shm").glob("psm_*")) if Path("/dev/shm").is_dir() else set()
    safe_ms, in_skin, aborted = [], 0, 0
    with standing_bench(tmp_path) as bench:
        for i in range(KILLS):
            out = tmp_path / f"out{i}"
            window = subprocess.Popen(
                [sys.executable, str(script), str(tmp_path), str(bench.rig), str(protocol), str(out)],
                stderr=subprocess.DEVNULL,
            )
            file = out / "001_index_0.40mm_r1.h5"
            until(lambda file=file: file.exists(), 120)
            # of a trial that is ended before its first sample there is nothing to keep
            until(
                lambda: bench.control.call("arm")["position_mm"] > 2.6,
                60,
                lambda: (tmp_path / "logs" / "window.log").read_text()[-2000:],
            )
            runner = psutil.Process(announcements()[0].pid)
            time.sleep(random.uniform(0.0, 5.5))
            in_skin += bool(bench.control.call("arm")["in_contact"])
            window.send_signal(signal.SIGKILL)
            killed = time.monotonic()
            window.wait()
            until(lambda: abs(bench.control.call("arm")["position_mm"] - SAFE_MM) < 0.3, 20)
            safe_ms.append(1e3 * (time.monotonic() - killed))
            until(
                lambda runner=runner: not runner.is_running() or runner.status() == psutil.STATUS_ZOMBIE, 30
            )
            assert abs(bench.control.call("arm")["position_mm"] - SAFE_MM) < 0.3
            trial = read_trial(file)
            assert trial.status in {"aborted", "complete"}, trial.status
            aborted += trial.status == "aborted"
            assert announcements() == []
    left = set(Path("/dev/shm").glob("psm_*")) - rings if rings or Path("/dev/shm").is_dir() else set()
    print(
        f"\n{KILLS} windows killed, {in_skin} with the punch in the skin: the runner ended, the file was kept "
        f"({aborted} aborted, {KILLS - aborted} complete), the arm was clear, {KILLS} times\n"
        f"arm at the safe position after: median {np.median(safe_ms):.0f} ms, maximum {np.max(safe_ms):.0f} ms; "
        f"shared memory left behind: {len(left)}"
    )


def until(condition: Callable[[], object], patience_s: float, why: Callable[[], object] = lambda: "") -> None:
    """Wait for a condition; ``why`` says what may have kept it from coming."""
    deadline = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < deadline, why()
        time.sleep(0.005)
