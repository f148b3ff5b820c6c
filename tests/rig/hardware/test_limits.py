"""Limits: what is refused before it is sent, and what is seen while the arm moves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.hardware.errors import LimitHit, LimitRefusedError
from rig.hardware.limits import Watch, refuse_beyond_limits
from rig.settings.rig_file import CalibrationSettings, LeverSettings

RATE_HZ = 8000.0
LIMITS = LeverSettings(speed_max_mm_s=50.0)
CALIBRATION = CalibrationSettings().nominal()


def refused(waveform_mm: np.ndarray, from_mm: float | None = None) -> str:
    with pytest.raises(LimitRefusedError, match="nothing was sent") as caught:
        refuse_beyond_limits(waveform_mm, LIMITS, rate_hz=RATE_HZ, from_mm=from_mm)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("waveform_mm", "words"),
    [
        (np.array([1.0, np.nan, 1.0]), "no number"),
        (np.array([1.0, np.inf]), "no number"),
        (np.linspace(9.4, 9.6, 800), "beyond the travel"),
        (np.linspace(0.1, -0.1, 800), "beyond the travel"),
        (np.linspace(1.0, 2.0, 100), "above lever.speed_max_mm_s = 50"),
        (np.array([1.0]), "2 samples"),
        (np.zeros((2, 100)), "2 samples"),
    ],
)
def test_a_waveform_that_is_not_for_this_lever_is_refused(waveform_mm: np.ndarray, words: str) -> None:
    assert words in refused(waveform_mm)


def test_a_jump_at_the_start_is_refused() -> None:
    assert "begins at 3.000 mm while the arm is at 2.900 mm" in refused(np.linspace(3.0, 4.0, 8000), 2.9)
    refuse_beyond_limits(np.linspace(3.0, 4.0, 8000), LIMITS, rate_hz=RATE_HZ, from_mm=2.995)


@given(
    low=st.floats(0.0, 9.5),
    high=st.floats(0.0, 9.5),
    speed_mm_s=st.floats(0.1, 49.9),
)
def test_what_stays_inside_is_not_refused(low: float, high: float, speed_mm_s: float) -> None:
    n = max(int(np.ceil(abs(high - low) / speed_mm_s * RATE_HZ)) + 1, 2)
    refuse_beyond_limits(np.linspace(low, high, n), LIMITS, rate_hz=RATE_HZ, from_mm=low)


def volts(position_mm: np.ndarray, force_mn: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    c = CALIBRATION
    position_v = position_mm * c.volts_per_mm + c.position_zero_v
    return position_v, force_mn * c.volts_per_mn + c.force_zero_v, position_v.copy()


def still(n: int = 100, force_mn: float = 20.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return volts(np.full(n, 5.0), np.full(n, force_mn))


def hit(position_v: np.ndarray, force_v: np.ndarray, command_v: np.ndarray, start: int = 0) -> LimitHit:
    with pytest.raises(LimitHit) as caught:
        Watch(LIMITS, CALIBRATION, 10.0).check(start, position_v, force_v, command_v)
    assert "\n" not in str(caught.value)
    return caught.value


@pytest.mark.parametrize("sign", [1, -1])
def test_a_force_above_the_limit_is_seen_where_it_is(sign: int) -> None:
    position_v, force_v, command_v = still()
    force_v[60:] = sign * 420.0 * CALIBRATION.volts_per_mn
    seen = hit(position_v, force_v, command_v, start=1000)
    assert seen.limit == "force"
    assert seen.sample == 1063
    assert seen.value == pytest.approx(sign * 420.0)
    assert seen.position_mm == pytest.approx(5.0)
    assert "420 mN where 400 mN is allowed" in str(seen)


def test_one_spike_is_no_hit_and_a_streak_over_two_blocks_is() -> None:
    watch = Watch(LIMITS, CALIBRATION, 10.0)
    position_v, force_v, command_v = still()
    force_v[50] = 450.0 * CALIBRATION.volts_per_mn
    watch.check(0, position_v, force_v, command_v)
    force_v[50] = 0.0
    force_v[-2:] = 450.0 * CALIBRATION.volts_per_mn
    watch.check(100, position_v, force_v, command_v)
    with pytest.raises(LimitHit) as caught:
        watch.check(200, *still(force_mn=450.0))
    assert caught.value.sample == 201


def test_an_arm_that_does_not_follow_is_seen() -> None:
    position_v, force_v, command_v = still()
    command_v[30:] += 1.2 * CALIBRATION.command_volts_per_mm
    seen = hit(position_v, force_v, command_v)
    assert seen.limit == "following error"
    assert seen.value == pytest.approx(1.2)


@pytest.mark.parametrize("position_mm", [9.9, -0.4])
def test_an_arm_outside_its_travel_is_seen(position_mm: float) -> None:
    seen = hit(*volts(np.full(50, position_mm), np.zeros(50)))
    assert seen.limit == "travel"
    assert seen.value == pytest.approx(position_mm)


def test_a_force_input_at_its_end_is_seen() -> None:
    wide = LeverSettings(force_max_mn=500.0)
    calibration = CalibrationSettings(volts_per_mn=0.03).nominal()
    position_v, _, command_v = still()
    with pytest.raises(LimitHit) as caught:
        Watch(wide, calibration, 10.0).check(0, position_v, np.full(100, 9.9999), command_v)
    assert caught.value.limit == "saturation"


def test_a_sample_that_is_no_number_is_seen() -> None:
    position_v, force_v, command_v = still()
    force_v[7] = np.nan
    seen = hit(position_v, force_v, command_v, start=10)
    assert seen.limit == "not a number"
    assert seen.sample == 17
