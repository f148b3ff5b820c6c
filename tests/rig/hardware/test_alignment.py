"""The start of a command is found to the sample, or not claimed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rig.hardware.alignment import CommandTrack, StartFinder
from rig.hardware.retreat import straight_mm

LSB_V = 20 / 2**16
VOLTS_PER_MM = 2.042


def looped_back(
    volts: np.ndarray, held_v: float, shift: int, n: int, *, noise_v: float, offset_v: float, seed: int
) -> np.ndarray:
    """What a 16-bit input records of a 16-bit output that starts at sample ``shift``."""
    indices = np.arange(n) - shift
    out = np.where(indices < 0, held_v, volts[np.clip(indices, 0, len(volts) - 1)])
    out = np.round(out / LSB_V) * LSB_V
    rng = np.random.default_rng(seed)
    return np.round((out + offset_v + noise_v * rng.standard_normal(n)) / LSB_V) * LSB_V


def found(volts: np.ndarray, held_v: float, not_before: int, data: np.ndarray, step: int) -> int | None:
    finder = StartFinder(volts, held_v, not_before, LSB_V)
    for start in range(0, len(data), step):
        finder.feed(start, data[start : start + step])
    return finder.started_sample


@settings(max_examples=60, deadline=None)
# noise that leaves early puts the first guess far before the start of a slow ramp
@example(speed_mm_s=0.5, way_mm=-1.0, rests=(18, 222), noise_and_offset_mv=(0.5, 0.0), seed=306)
@given(
    speed_mm_s=st.floats(0.5, 60.0),
    way_mm=st.floats(0.05, 3.0) | st.floats(-3.0, -0.05),
    rests=st.tuples(st.integers(16, 6000), st.integers(0, 300)),
    noise_and_offset_mv=st.tuples(st.floats(0.1, 0.5), st.floats(-5.0, 5.0)),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_ramp_is_found_to_the_sample(
    speed_mm_s: float,
    way_mm: float,
    rests: tuple[int, int],
    noise_and_offset_mv: tuple[float, float],
    seed: int,
) -> None:
    rest, late = rests
    noise_mv, offset_mv = noise_and_offset_mv
    volts = straight_mm(5.0, 5.0 + way_mm, speed_mm_s=speed_mm_s, rate_hz=8000.0) * VOLTS_PER_MM - 10.0
    shift = rest + late
    data = looped_back(
        volts,
        float(volts[0]),
        shift,
        shift + len(volts) + 400,
        noise_v=noise_mv / 1e3,
        offset_v=offset_mv / 1e3,
        seed=seed,
    )
    # one sample off would show as more than 5 noise deviations: less than one false find in a million
    start = found(volts, float(volts[0]), rest, data, step=80)
    assert start == shift or (start is None and speed_mm_s < 2.0)


@settings(max_examples=40, deadline=None)
@given(rest=st.integers(0, 300), noise_mv=st.floats(0.0, 0.5), seed=st.integers(0, 2**32 - 1))
def test_nothing_is_claimed_while_the_output_rests(rest: int, noise_mv: float, seed: int) -> None:
    still = np.full(800, -3.0)
    moving = np.linspace(-3.0, 4.0, 800)
    data = looped_back(still, -3.0, rest, 2000, noise_v=noise_mv / 1e3, offset_v=0.0, seed=seed)
    assert found(still, -3.0, rest, data, 80) is None
    assert found(moving, -3.0, rest, data, 80) is None


@pytest.mark.parametrize("rest", [16, 400, 4000, 16000])
def test_a_short_ramp_is_found_while_it_still_moves(rest: int) -> None:
    volts = straight_mm(3.4, 3.8, speed_mm_s=5.0, rate_hz=8000.0) * VOLTS_PER_MM - 10.0
    shift = rest + 20
    n = shift + len(volts) // 2
    data = looped_back(volts, float(volts[0]), shift, n, noise_v=3e-4, offset_v=1e-3, seed=1)
    finder = StartFinder(volts, float(volts[0]), rest, LSB_V)
    finder.feed(0, data[:rest])
    for start in range(rest, n, 40):
        finder.feed(start, data[start : start + 40])
    assert finder.started_sample == shift


def test_the_end_of_the_motion_before_does_not_mislead() -> None:
    before = np.linspace(-5.0, -3.0, 300)
    volts = np.linspace(-3.0, -2.0, 1000)
    data = np.concatenate([before, np.full(40, -3.0), volts, np.full(200, -2.0)])
    assert found(volts, -3.0, 320, data, 64) == 340


def test_a_finder_is_not_fed_by_what_came_after_its_motion() -> None:
    volts = np.full(100, 1.0)
    finder = StartFinder(np.linspace(0.0, 1.0, 1000), 0.0, 50, LSB_V)
    finder.end_at(60)
    finder.feed(0, np.concatenate([np.zeros(60), volts]))
    assert finder.started_sample is None
    assert not finder.searching


def test_the_track_holds_before_between_and_after() -> None:
    track = CommandTrack(-9.0)
    assert track.volts(5, 8) == pytest.approx([-9.0] * 3)
    track.add(10, np.array([1.0, 2.0, 3.0]))
    assert track.volts(8, 15) == pytest.approx([-9.0, -9.0, 1.0, 2.0, 3.0, 3.0, 3.0])
    track.cut(2, 2.5)
    assert track.volts(8, 15) == pytest.approx([-9.0, -9.0, 1.0, 2.0, 2.5, 2.5, 2.5])
    assert track.last_v == 2.5
    track.add(20, np.array([7.0]))
    assert track.volts(19, 22) == pytest.approx([2.5, 7.0, 7.0])
