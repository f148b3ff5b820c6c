"""One rig, one run: whoever comes next waits for what a run leaves behind, and is refused while it goes on."""

from __future__ import annotations

import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil
import pytest

from rig.hardware.occupancy import RigBusyError, RigLock

LEFT_FOR_S = 1.0
RUN = """
import subprocess
import sys
from rig.hardware.occupancy import RigLock

address, leaves = sys.argv[1:]
with RigLock(address, "Dev1") as lock:
    if float(leaves):
        # a guard outlives the run a little, and holds the lock meanwhile
        subprocess.Popen(["sleep", leaves], pass_fds=lock.fds, stdout=subprocess.DEVNULL)
    else:
        print("held", flush=True)
        sys.stdin.readline()
print("over", flush=True)
sys.stdin.readline()
"""


@contextmanager
def another_process(address: str, leaves_s: float) -> Iterator[subprocess.Popen[str]]:
    """A process with a run that leaves a holder of the lock behind (0: that goes on); it lives on itself."""
    process = subprocess.Popen(
        [sys.executable, "-c", RUN, address, str(leaves_s)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.fixture
def address(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    return f"test-{uuid.uuid4()}"


def test_the_guards_of_a_run_that_is_over_are_waited_for(address: str) -> None:
    """Also where the process that had the run lives on, as a program that makes several does."""
    with another_process(address, LEFT_FOR_S) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "over\n"
        began_s = time.monotonic()
        with RigLock(address, "Dev1"):
            assert time.monotonic() - began_s > LEFT_FOR_S / 2
        assert other.poll() is None


def test_a_run_that_goes_on_keeps_others_out(address: str) -> None:
    with another_process(address, 0.0) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        with pytest.raises(RigBusyError, match=f"another run has this rig: process {other.pid}"):
            RigLock(address, "Dev1").__enter__()
        other.kill()
        other.wait()
        with RigLock(address, "Dev1"):
            pass


@pytest.mark.skipif(
    sys.platform != "linux", reason="elsewhere a change of the clock moves no process's beginning"
)
def test_a_clock_that_is_set_makes_no_run_a_dead_one(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else `indenter safe` would take the card, and the guards, from a run that goes on."""
    with another_process(address, 0.0) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        boot_s = psutil.boot_time()
        # the system tells all its times by the clock, which has been put on by an hour
        monkeypatch.setattr(psutil._pslinux, "boot_time", lambda: boot_s + 3600.0)
        assert psutil.boot_time() == boot_s + 3600.0
        with pytest.raises(RigBusyError, match=f"another run has this rig: process {other.pid}"):
            RigLock(address, "Dev1", end_guards=True).__enter__()
