"""The way to safety with nothing but the card."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.hardware import retreat
from rig.hardware.daq import Card
from rig.hardware.errors import RetreatFailedError, SamplesLostError
from rig.hardware.retreat import (
    Bearings,
    Retreat,
    RetreatWatch,
    bring_to_safety,
    output_now_v,
    straight_mm,
)
from rig.settings.rig_file import CalibrationSettings, CardSettings, LeverSettings

CALIBRATION = CalibrationSettings().nominal()


@given(st.floats(0, 9.5), st.floats(0, 9.5), st.floats(0.1, 100.0))
def test_a_straight_way_keeps_its_ends_and_its_speed(from_mm: float, to_mm: float, speed_mm_s: float) -> None:
    way_mm = straight_mm(from_mm, to_mm, speed_mm_s=speed_mm_s, rate_hz=8000.0)
    assert len(way_mm) >= 2
    assert way_mm[0] == from_mm
    assert way_mm[-1] == to_mm
    assert np.abs(np.diff(way_mm)).max() * 8000.0 <= speed_mm_s * (1 + 1e-6) + 1e-9


def volts(mm: float) -> float:
    return mm * CALIBRATION.command_volts_per_mm + CALIBRATION.command_zero_v


def where(position_mm: float, loopback_mm: float | None, bearings: Bearings | None = None) -> float:
    seen = np.array([[volts(position_mm)], [0.0], [volts(loopback_mm or 0.0)]])
    at_v = output_now_v(
        seen, CALIBRATION, LeverSettings(), loopback_wired=loopback_mm is not None, bearings=bearings
    )
    return (at_v - CALIBRATION.command_zero_v) / CALIBRATION.command_volts_per_mm


def test_the_loopback_says_where_the_output_is_unless_the_position_contradicts_it() -> None:
    assert where(5.0, 5.2) == pytest.approx(5.2)
    assert where(5.0, None) == pytest.approx(5.0)
    with pytest.raises(RetreatFailedError, match="nobody knows"):
        where(9.0, 4.9)


def test_what_was_told_of_the_output_is_never_left() -> None:
    told = Bearings(volts(2.0), volts(5.0), volts(0.5))
    assert where(9.0, 4.9, told) == pytest.approx(4.9), "a dead position line does not matter"
    assert where(4.8, 9.5, told) == pytest.approx(4.8), "nor does a dead loop-back"
    assert where(9.0, 9.5, told) == pytest.approx(5.0)
    assert where(9.0, None, told) == pytest.approx(5.0)


@given(by_mm=st.sampled_from([-4.0, 0.3]), moved_mm=st.floats(-4.0, 0.09), rise_mn=st.floats(-500.0, 9.0))
def test_a_way_to_safety_that_does_not_press_is_let_be(by_mm: float, moved_mm: float, rise_mn: float) -> None:
    c = CALIBRATION
    before = np.array([[volts(5.0)], [0.0]])
    after = np.array([[volts(5.0 + moved_mm)], [rise_mn * c.volts_per_mn]])
    RetreatWatch(before, by_mm * c.command_volts_per_mm, c).check(after)


@pytest.mark.parametrize(
    ("by_mm", "moved_mm", "rise_mn"), [(-4.0, 0.1, 25.0), (-4.0, 0.0, 25.0), (0.3, 0.2, 12.0)]
)
def test_a_way_to_safety_that_presses_is_stopped(by_mm: float, moved_mm: float, rise_mn: float) -> None:
    c = CALIBRATION
    before = np.array([[volts(5.0)], [0.0]])
    after = np.array([[volts(5.0 + moved_mm)], [rise_mn * c.volts_per_mn]])
    with pytest.raises(RetreatFailedError, match="lift it by hand"):
        RetreatWatch(before, by_mm * c.command_volts_per_mm, c).check(after)


def test_an_arm_that_flees_is_let_go_whatever_its_force_line_says() -> None:
    c = CALIBRATION
    before = np.array([[volts(5.0)], [0.0]])
    after = np.array([[volts(4.8)], [400.0 * c.volts_per_mn]])
    RetreatWatch(before, -4.0 * c.command_volts_per_mm, c).check(after)


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
