"""The live view of the resting arm tells when nothing can be read, and when it can again."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from analysis.recordings.trial import Calibration
from rig.engine.idling import LiveView
from rig.hardware.errors import HardwareError, LimitHit
from rig.hardware.lever import Chunk

CALIBRATION = Calibration(2.042, -10.0, 0.015, 0.0, 2.042, -10.0)
KNOCK = LimitHit("force", sample=8, value=410.0, unit="mN", allowed=400.0, position_mm=0.5)


class Wire:
    """A lever at rest whose card can be unplugged: `fault` is what every call then raises."""

    sample_rate_hz = 8000.0
    acquired = 0

    def __init__(self) -> None:
        self.fault: HardwareError | None = None
        self.retreats = 0

    def _answer(self) -> None:
        if self.fault is not None:
            raise self.fault

    def start_recording(self) -> None:
        self._answer()

    def stop_recording(self) -> None:
        self._answer()

    def retreat(self) -> None:
        self.retreats += 1

    def read(self, n: int) -> Chunk:
        self._answer()
        volts = np.zeros(n)
        return Chunk(0, volts, volts, volts, CALIBRATION)


def looked(live: LiveView) -> str:
    """What it says after two looks, the pause after a fault being over."""
    live._not_before = 0.0
    live.look()
    time.sleep(0.002)
    live.look()
    return live.trouble


@pytest.mark.parametrize(
    ("fault", "retreats"), [(HardwareError("card Dev1: does not\nanswer"), 0), (KNOCK, 1)]
)
def test_what_keeps_the_arm_from_being_read_is_told_until_it_is_read(
    fault: HardwareError, retreats: int
) -> None:
    wire: Any = Wire()
    followed: list[int] = []
    live = LiveView(wire, lambda: None, lambda chunk: followed.append(chunk.n))
    assert looked(live) == ""
    assert followed
    wire.fault = fault
    time.sleep(0.002)
    live.look()
    assert live.trouble == " ".join(str(fault).split())
    assert wire.retreats == retreats
    live._not_before = 0.0
    if not isinstance(fault, LimitHit):
        live.look()
        assert live.trouble, "it stands until a sample has come"
    wire.fault = None
    n_followed = len(followed)
    assert looked(live) == ""
    assert len(followed) > n_followed
