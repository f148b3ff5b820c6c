"""The lever on the simulated card, through the real driver client."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from rig.errors import RigError
from rig.hardware.errors import (
    ArmNotProvenError,
    CardError,
    CardMissingError,
    LimitHit,
    LimitRefusedError,
    RetreatFailedError,
)
from rig.hardware.lever import Chunk, Lever, Playback
from rig.hardware.limits import Watch
from rig.hardware.retreat import straight_mm

RunningBench = Any  # of this folder's conftest, which no test module can import

SAFE_V = 0.5 * 2.042 - 10.0
ONE_STEP_V = 20 / 2**16


def way_mm(lever: Lever, to_mm: float, speed_mm_s: float = 20.0) -> np.ndarray:
    return straight_mm(lever.commanded_mm, to_mm, speed_mm_s=speed_mm_s, rate_hz=lever.sample_rate_hz)


def read_to_end(lever: Lever, playback: Playback, n: int = 80) -> np.ndarray:
    """Every sample up to the end of a motion: position, force and command, (3, n), volts."""
    chunks = []
    while not playback.done:
        chunk = lever.read(n)
        chunks.append(np.array([chunk.position_v, chunk.force_v, chunk.command_v]))
    return np.concatenate(chunks, axis=1)


@pytest.fixture
def lever(bench: RunningBench) -> Iterator[Lever]:
    bench.control.call("request", "clear_air", {})
    with bench.lever() as opened:
        opened.retreat()
        opened.start_recording()
        yield opened


def test_the_arm_goes_where_it_is_sent_and_both_signals_say_so(lever: Lever) -> None:
    playback = lever.play(way_mm(lever, 3.0))
    read_to_end(lever, playback)
    assert lever.commanded_mm == pytest.approx(3.0)
    lever.read(40)
    after = lever.read(80)
    assert after.command_mm == pytest.approx(3.0, abs=0.002)
    # the nominal constants are some percent off
    assert after.position_mm == pytest.approx(3.0, abs=0.3)


def test_chunks_follow_each_other(lever: Lever) -> None:
    stop = lever.read(17).stop
    for n in (1, 80, 333, 24):
        chunk = lever.read(n)
        assert (chunk.start, chunk.n) == (stop, n)
        stop = chunk.stop
    assert lever.acquired >= stop


def test_every_sample_is_kept_once_whether_it_is_read_or_not(bench: RunningBench) -> None:
    kept: list[Chunk] = []
    bench.control.call("request", "clear_air", {})
    with bench.lever() as lever:
        lever.retreat()
        lever.start_recording(kept.append)
        playback = lever.play(way_mm(lever, 3.0))
        read = read_to_end(lever, playback)
        lever.retreat()
        lever.stop_recording()
    assert [c.start for c in kept] == [0, *(c.stop for c in kept[:-1])]
    channels = np.hstack([[c.position_v, c.force_v, c.command_v] for c in kept])
    assert channels.shape[1] > read.shape[1]
    np.testing.assert_array_equal(channels[:, : read.shape[1]], read)


def test_the_start_of_a_motion_is_found_to_the_sample(lever: Lever) -> None:
    lever.read(100)
    playback = lever.play(way_mm(lever, 2.0, speed_mm_s=5.0))
    begin = lever.read(1).start
    command_v = np.concatenate([lever.read(1).command_v, read_to_end(lever, playback)[2]])
    assert not playback.alignment_unknown
    assert playback.started_sample is not None
    first = playback.started_sample - begin - 1
    assert command_v[first : first + playback.n] == pytest.approx(playback.volts, abs=3 * ONE_STEP_V)


def test_a_late_start_is_found_to_the_sample(bench_of: Callable[..., Any]) -> None:
    with bench_of() as bench, bench.lever() as lever:
        for late in (1, 37, 400):
            lever.retreat()
            lever.start_recording()
            lever.read(100)
            bench.control.call("fault", "late_start", {"samples": late})
            playback = lever.play(way_mm(lever, 2.0, speed_mm_s=5.0))
            read_to_end(lever, playback)
            lever.read(late + 8)
            assert playback.started_sample == playback.expected_sample + late
            lever.stop_recording()
            bench.control.call("fault", "late_start", {"samples": late})
            chunk, playback = lever.record_once(way_mm(lever, 3.0), tail_s=0.1)
            assert playback.started_sample == late
            moved = chunk.command_v[late : late + playback.n]
            assert moved == pytest.approx(playback.volts, abs=3 * ONE_STEP_V)


def test_without_loopback_nothing_is_claimed_and_a_halt_is_right_to_some_samples(
    bench_of: Callable[..., Any],
) -> None:
    with bench_of(wired=False) as bench, bench.lever() as lever:
        lever.retreat()
        lever.start_recording()
        lever.read(100)
        playback = lever.play(way_mm(lever, 2.0))
        samples = read_to_end(lever, playback)
        assert playback.alignment_unknown
        assert playback.started_sample is None
        # the sent command stands at its expected place
        first = playback.expected_sample - 100
        assert samples[2, first : first + 100] == pytest.approx(playback.volts[:100])
        assert lever.commanded_mm == pytest.approx(2.0)
        lever.play(way_mm(lever, 6.0, speed_mm_s=5.0))
        lever.read(2400)
        stopped_mm = lever.halt()
        c = lever.calibration
        true_mm = (bench.arm()["command_v"] - c.command_zero_v) / c.command_volts_per_mm
        assert stopped_mm == pytest.approx(true_mm, abs=0.005)
        assert 3.0 < stopped_mm < 5.0


def test_a_loopback_that_is_declared_and_not_wired_is_told(bench_of: Callable[..., Any]) -> None:
    with bench_of() as bench:
        rig = bench.rig.model_copy(
            update={"card": bench.rig.card.model_copy(update={"loopback_channel": "ai3"})}
        )
        with pytest.raises(ArmNotProvenError, match=r"card\.loopback_channel"), bench.lever(rig):
            pass
        assert bench.arm()["command_v"] == pytest.approx(-9.5, abs=0.001), "nothing was moved"


def test_halt_stops_the_arm_and_says_where(lever: Lever, bench: RunningBench) -> None:
    playback = lever.play(way_mm(lever, 6.0, speed_mm_s=5.0))
    lever.read(2400)
    stopped_mm = lever.halt()
    assert lever.commanded_mm == stopped_mm
    assert playback.done
    assert playback.stopped
    c = lever.calibration
    assert stopped_mm == pytest.approx(
        (bench.arm()["command_v"] - c.command_zero_v) / c.command_volts_per_mm, abs=0.001
    )
    assert 1.0 < stopped_mm < 3.0
    lever.read(400)
    assert lever.read(400).command_mm == pytest.approx(stopped_mm, abs=0.001)
    # and the next motion begins there, without a step
    after = lever.play(way_mm(lever, 1.0, speed_mm_s=5.0))
    command_v = read_to_end(lever, after)[2]
    assert np.abs(np.diff(command_v)).max() < 5.0 / 8000 * 2.042 + 6 * ONE_STEP_V


def test_an_arm_is_stopped_by_what_its_samples_show(lever: Lever, bench: RunningBench) -> None:
    shown: list[Chunk] = []

    def beyond_3_mm(chunk: Chunk) -> bool:
        shown.append(chunk)
        return bool(chunk.position_mm[-1] > 3.0)

    playback = lever.play_until(way_mm(lever, 6.0, speed_mm_s=5.0), beyond_3_mm, 40)
    assert playback is not None
    while not playback.done:
        lever.read(400)
    assert playback.stopped
    stopped_mm = lever.halt()
    assert stopped_mm == lever.commanded_mm
    # one read of 5 ms too late at most, though the program reads 50 ms at a time
    assert 3.0 <= stopped_mm < 3.0 + 5.0 * 0.005 + 0.01
    c = lever.calibration
    assert stopped_mm == pytest.approx(
        (bench.arm()["command_v"] - c.command_zero_v) / c.command_volts_per_mm, abs=0.001
    )
    assert max(chunk.n for chunk in shown) == 40
    # nothing is looked at any more, and the way back is free
    n_shown = len(shown)
    read_to_end(lever, lever.play(way_mm(lever, 4.0)))
    assert len(shown) == n_shown
    assert lever.commanded_mm == pytest.approx(4.0)


def test_a_limit_hit_before_a_stop_is_read_back_begins_the_way_where_the_arm_is(
    lever: Lever, monkeypatch: pytest.MonkeyPatch
) -> None:
    def hit(start: int, position_v: np.ndarray, *_: np.ndarray) -> None:
        raise LimitHit("force", sample=start, value=1.0, unit="mN", allowed=0.0, position_mm=3.0)

    def beyond_3_mm(chunk: Chunk) -> bool:
        beyond = bool(chunk.position_mm[-1] > 3.0)
        if beyond:
            monkeypatch.setattr(Watch, "check", lambda self, *block: hit(*block))
        return beyond

    lever.play_until(way_mm(lever, 6.0, speed_mm_s=5.0), beyond_3_mm, 40)
    with pytest.raises(LimitHit):
        while True:
            lever.read(400)
    after = lever.read(4000)
    # towards the 6 mm at which the motion would have ended it never goes
    assert after.command_mm.max() < 3.05
    assert np.abs(np.diff(after.command_mm)).max() < 0.03
    assert after.command_mm[-1] == pytest.approx(lever.limits.safe_position_mm, abs=0.01)


def test_halt_of_an_arm_at_rest_changes_nothing(lever: Lever) -> None:
    before_mm = lever.commanded_mm
    assert lever.halt() == before_mm


@pytest.mark.parametrize(
    ("waveform_mm", "words"),
    [
        (np.linspace(0.5, 9.8, 8000), "beyond the travel"),
        (np.linspace(0.5, 5.0, 80), "above lever.speed_max_mm_s"),
        (np.array([0.5, np.nan, 0.5]), "no number"),
        (np.linspace(2.0, 3.0, 8000), "begin where the arm is"),
    ],
)
def test_nothing_is_sent_of_a_refused_motion(
    lever: Lever, bench: RunningBench, waveform_mm: np.ndarray, words: str
) -> None:
    with pytest.raises(LimitRefusedError, match="nothing was sent") as caught:
        lever.play(waveform_mm)
    assert words in str(caught.value)
    lever.read(400)
    assert bench.arm()["command_v"] == pytest.approx(SAFE_V, abs=2 * ONE_STEP_V)


def test_a_motion_on_top_of_a_motion_is_refused(lever: Lever) -> None:
    lever.play(way_mm(lever, 3.0))
    with pytest.raises(LimitRefusedError, match="still moves"):
        lever.play(np.linspace(3.0, 2.0, 8000))


def test_misuse_is_told(lever: Lever) -> None:
    with pytest.raises(RigError, match="recording is on"):
        lever.start_recording()
    with pytest.raises(RigError, match="recording is on"):
        lever.record_once(way_mm(lever, 1.0))
    lever.stop_recording()
    for call in (lambda: lever.read(8), lambda: lever.play(way_mm(lever, 1.0)), lever.halt):
        with pytest.raises(RigError, match="recording is off"):
            call()


def test_a_force_limit_retracts_says_so_and_goes_on_recording(bench_of: Callable[..., Any]) -> None:
    with bench_of(lever="force_max_mn = 60.0") as bench, bench.lever() as lever:
        bench.control.call("request", "place_finger", {"finger": "index", "site": "1", "repeat": 1})
        lever.retreat()
        lever.start_recording()
        lever.play(way_mm(lever, 8.0, speed_mm_s=5.0))
        with pytest.raises(LimitHit) as caught:
            while True:
                lever.read(80)
        seen = caught.value
        assert seen.limit == "force"
        assert 60.0 < seen.value < 80.0
        # further motion is refused until the arm has been brought to safety
        with pytest.raises(LimitRefusedError, match="retreat"):
            lever.play(way_mm(lever, 1.0))
        force_mn, start = [], lever.read(1).stop
        for _ in range(50):
            chunk = lever.read(80)
            assert chunk.start == start
            start = chunk.stop
            force_mn.append(chunk.force_mn)
        assert np.concatenate(force_mn).max() < 75.0
        assert abs(float(chunk.force_mn.mean())) < 30.0
        lever.retreat()
        assert bench.arm()["command_v"] == pytest.approx(SAFE_V, abs=2 * ONE_STEP_V)
        assert not bench.arm()["in_contact"]
        read_to_end(lever, lever.play(way_mm(lever, 1.0)))


def test_retreat_is_slew_limited_and_recorded(lever: Lever, bench: RunningBench) -> None:
    read_to_end(lever, lever.play(way_mm(lever, 7.0, speed_mm_s=50.0)))
    before = lever.read(1).stop
    lever.retreat()
    command_v = lever.read(lever.acquired - before).command_v
    speed_mm_s = np.abs(np.diff(command_v)).max() / 2.042 * 8000
    assert 30.0 < speed_mm_s < 50.0
    assert bench.arm()["command_v"] == pytest.approx(SAFE_V, abs=2 * ONE_STEP_V)
    assert lever.commanded_mm == pytest.approx(0.5)


def test_leaving_brings_the_arm_to_safety(bench: RunningBench) -> None:
    with pytest.raises(KeyboardInterrupt), bench.lever() as lever:
        lever.retreat()
        lever.start_recording()
        lever.play(way_mm(lever, 7.0))
        lever.read(1000)
        raise KeyboardInterrupt
    assert bench.arm()["command_v"] == pytest.approx(SAFE_V, abs=2 * ONE_STEP_V)


def test_the_card_gone_in_mid_motion_is_told_and_nothing_hangs(bench_of: Callable[..., Any]) -> None:
    with bench_of() as bench:
        began_s = time.monotonic()
        with pytest.raises((CardMissingError, RetreatFailedError)) as caught, bench.lever() as lever:
            lever.retreat()
            lever.start_recording()
            playback = lever.play(way_mm(lever, 7.0))
            bench.control.call("fault", "unplug", {})
            read_to_end(lever, playback)
        assert "-201003" in str(caught.value)
        assert time.monotonic() - began_s < 20.0


def test_a_server_that_dies_in_mid_motion_is_told(bench_of: Callable[..., Any]) -> None:
    with bench_of() as bench, pytest.raises(CardError) as caught, bench.lever() as lever:
        lever.retreat()
        lever.start_recording()
        playback = lever.play(way_mm(lever, 7.0))
        bench.companion.close()
        read_to_end(lever, playback)
    # a call under way when the server ends is told so, the next one finds nobody
    assert re.search("card's server (does not answer|closed the connection)", str(caught.value))


def test_a_coerced_rate_is_refused(bench_of: Callable[..., Any]) -> None:
    with bench_of() as bench:
        bench.control.call("fault", "coerce_rate", {"rate_hz": 7812.5})
        with pytest.raises(CardError, match=r"7812\.5"), bench.lever():
            pass


@pytest.mark.parametrize("stall_s", [1.0, pytest.param(10.0, marks=pytest.mark.slow)])
def test_a_program_that_stalls_loses_nothing(real_time_bench: RunningBench, stall_s: float) -> None:
    with real_time_bench.lever() as lever:
        lever.retreat()
        lever.start_recording()
        playback = lever.play(way_mm(lever, 4.0, speed_mm_s=10.0))
        first = lever.read(80)
        time.sleep(stall_s)
        assert lever.acquired > 7000 * stall_s
        rest = lever.read(round(8000 * stall_s))
        assert rest.start == first.stop
        started = playback.started_sample
        assert started is not None
        command_v = np.concatenate([first.command_v, rest.command_v])
        n = min(playback.n, len(command_v) - started)
        assert command_v[started : started + n] == pytest.approx(playback.volts[:n], abs=4 * ONE_STEP_V)


def test_limits_are_watched_while_the_program_stalls(bench_of: Callable[..., Any]) -> None:
    with bench_of(time="real", lever="force_max_mn = 60.0") as bench, bench.lever() as lever:
        bench.control.call("request", "place_finger", {"finger": "index", "site": "1", "repeat": 1})
        lever.retreat()
        lever.start_recording()
        lever.play(way_mm(lever, 8.0, speed_mm_s=20.0))
        time.sleep(1.0)
        assert bench.arm()["command_v"] == pytest.approx(SAFE_V, abs=2 * ONE_STEP_V)
        with pytest.raises(LimitHit):
            lever.read(80)
