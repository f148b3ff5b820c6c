"""`indenter gui` as a program: it opens, and ends cleanly with its bench."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rig.engine.announcing import announcements


def test_it_opens_and_ends_with_exit_code_0(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, real_time_rig: str
) -> None:
    monkeypatch.setenv("INDENTER_RUNTIME_DIR", str(tmp_path / "runs"))
    (tmp_path / "rig.toml").write_text(real_time_rig)
    command = [sys.executable, "-m", "rig.cli", "gui", "--rig", str(tmp_path / "rig.toml")]
    window = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 90
    while not announcements():
        assert window.poll() is None, window.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    bench = announcements()[0].pid
    window.send_signal(signal.SIGTERM)
    _, said = window.communicate(timeout=60)
    assert window.returncode == 0, said
    assert "Traceback" not in said
    assert announcements() == []
    with pytest.raises(ProcessLookupError):
        os.kill(bench, 0)
