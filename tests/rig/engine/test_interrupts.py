"""A stop is heard whatever the terminal does."""

from __future__ import annotations

import signal
import subprocess
import sys

WAITING = """
import time
from rig.engine.interrupts import Interrupted, Interrupts

with Interrupts() as interrupts:
    print("ready", flush=True)
    try:
        while True:
            interrupts.check()
            time.sleep(0.01)
    except Interrupted:
        print("heard", flush=True)
"""


def test_a_terminal_that_takes_nothing_does_not_hold_up_a_stop(full_pipe: tuple[int, int]) -> None:
    """Held by Ctrl-S, or a pipe that nobody empties."""
    _, writes = full_pipe
    process = subprocess.Popen(
        [sys.executable, "-c", WAITING], stdout=subprocess.PIPE, stderr=writes, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGTERM)
    try:
        said, _ = process.communicate(timeout=20.0)
        assert said == "heard\n"
        assert process.returncode == 0
    finally:
        process.kill()
        process.communicate()
