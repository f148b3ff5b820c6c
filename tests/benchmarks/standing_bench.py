"""A simulated bench that outlives those who use it, and a witness of where its arm truly is."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rig.hardware.companion import Companion
from rig.hardware.remote import ControlService
from rig.settings.reading import parse_rig

BENCH = """
[companion]
command = ["{python}", "-m", "sim_hardware"]
[companion.settings]
seed = 3
time = "real"
"""

_WITNESS = """
import sys, time
from rig.hardware.remote import ControlService
control = ControlService(sys.argv[1])
with open(sys.argv[2], "w", buffering=1) as out:
    while True:
        before = time.time()
        position = control.call("arm")["position_mm"]
        out.write(f"{(before + time.time()) / 2:.6f} {position:.6f}\\n")
        time.sleep(0.003)
"""


@dataclass(frozen=True)
class StandingBench:
    """The bench's control service, a rig file that names it, and the witness's record."""

    control: ControlService
    rig: Path
    track: Path

    def positions(self) -> np.ndarray:
        """Return what the witness saw so far, (n, 2): time of the clock on the wall s, position mm."""
        lines = self.track.read_text().splitlines()[:-1]
        return np.array([[float(word) for word in line.split()] for line in lines])


@contextmanager
def standing_bench(folder: Path) -> Iterator[StandingBench]:
    """Start a bench in real time, and a process that looks at its arm a few hundred times a second."""
    settings = parse_rig(BENCH, "bench").companion
    assert settings is not None
    with Companion(settings) as companion:
        address = companion.resolve("companion:control")
        with contextlib.suppress(PermissionError):
            # it stands for a card and an arm, which wait for no processor
            os.setpriority(os.PRIO_PROCESS, companion.pid, -10)
        rig, track = folder / "rig.toml", folder / "track.txt"
        rig.write_text(
            f'[card]\naddress = "{companion.resolve("companion:card")}"\nloopback_channel = "ai2"\n'
            f'[operator]\naddress = "{address}"\n[clock]\naddress = "{address}"\n'
        )
        control = ControlService(address)
        witness = subprocess.Popen([sys.executable, "-c", _WITNESS, address, str(track)])
        try:
            while not track.exists() or not track.read_text():
                time.sleep(0.05)
            yield StandingBench(control, rig, track)
        finally:
            witness.kill()
            witness.wait()
            control.close()
