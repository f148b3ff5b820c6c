"""The way to safety with nothing but the card."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.hardware import retreat
from rig.hardware.daq import Card
from rig.hardware.errors import SamplesLostError
from rig.hardware.retreat import Retreat, bring_to_safety, commanded_by_loopback_mm, straight_mm
from rig.settings.rig_file import CalibrationSettings, CardSettings, LeverSettings

CALIBRATION = CalibrationSettings().nominal()


@given(st.floats(0, 9.5), st.floats(0, 9.5), st.floats(0.1, 100.0))
def test_a_straight_way_keeps_its_ends_and_its_speed(from_mm: float, to_mm: float, speed_mm_s: float) -> None:
    way_mm = straight_mm(from_mm, to_mm, speed_mm_s=speed_mm_s, rate_hz=8000.0)
    assert len(way_mm) >= 2
    assert way_mm[0] == from_mm
    assert way_mm[-1] == to_mm
    assert np.abs(np.diff(way_mm)).max() * 8000.0 <= speed_mm_s * (1 + 1e-6) + 1e-9


def test_a_loopback_far_from_the_position_is_not_believed() -> None:
    c, lever = CALIBRATION, LeverSettings()
    near_v = 5.2 * c.command_volts_per_mm + c.command_zero_v
    assert commanded_by_loopback_mm(near_v, 5.0, c, lever) == pytest.approx(5.2)
    assert commanded_by_loopback_mm(0.0, 9.0, c, lever) == 9.0


def test_the_arm_is_brought_from_anywhere(bench: Any) -> None:
    rig = bench.rig
    for to_mm in (9.4, 0.0, 5.0):
        with bench.lever() as lever:
            lever.retreat()
            lever.start_recording()
            playback = lever.play(straight_mm(0.5, to_mm, speed_mm_s=50.0, rate_hz=8000.0))
            while not playback.done:
                lever.read(400)
            lever._drive.away = False  # leaves it where it is
        with Card(bench.card_address, rig.card.device) as card:
            done = bring_to_safety(card, rig.card, rig.lever, rig.calibration.nominal())
        assert done.from_mm == pytest.approx(to_mm, abs=0.4)
        assert bench.arm()["command_v"] == pytest.approx(0.5 * 2.042 - 10.0, abs=0.001)


@pytest.mark.parametrize("failures", [2, 3])
def test_a_computer_too_busy_to_read_begins_again(monkeypatch: pytest.MonkeyPatch, failures: int) -> None:
    tries: list[int] = []

    def busy(*_: object) -> Retreat:
        tries.append(1)
        if len(tries) <= failures:
            raise SamplesLostError("overwritten", -200279)
        return Retreat(5.0, 0.5, 0.1)

    monkeypatch.setattr(retreat, "_bring_to_safety", busy)
    with Card("127.0.0.1:9", "Dev1") as card:
        if failures == 2:
            assert bring_to_safety(card, CardSettings(), LeverSettings(), CALIBRATION).to_mm == 0.5
        else:
            with pytest.raises(SamplesLostError):
                bring_to_safety(card, CardSettings(), LeverSettings(), CALIBRATION)
    assert len(tries) == 3
