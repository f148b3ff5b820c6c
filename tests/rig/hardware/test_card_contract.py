"""What the hardware layer asks of a card, call for call.

Runs on the simulated card; `pytest --rig RIG.toml tests/rig/hardware/test_card_contract.py` runs it on a real
one, with nothing below the arm: it moves 0.3 mm about the safe position.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing

import numpy as np
import pytest

from rig.hardware.daq import Card, CardInput, CardOutput
from rig.hardware.errors import (
    CardBusyError,
    CardError,
    CardMissingError,
    RateCoercedError,
    SamplesLateError,
    SamplesLostError,
)
from rig.hardware.lever import Lever
from rig.hardware.retreat import bring_to_safety, straight_mm
from rig.settings.rig_file import RigFile

STEP_MM = 0.3


@pytest.fixture(scope="module")
def rig(card_rig: tuple[RigFile, str]) -> RigFile:
    return card_rig[0]


@pytest.fixture(scope="module")
def address(card_rig: tuple[RigFile, str]) -> str:
    return card_rig[1]


@pytest.fixture
def card(rig: RigFile, address: str) -> Iterator[Card]:
    with Card(address, rig.card.device) as opened:
        yield opened


@pytest.fixture
def open_input(card: Card, rig: RigFile) -> Callable[..., CardInput]:
    def opened(**changes: object) -> CardInput:
        s = rig.card
        channels = [s.position_channel, s.force_channel, s.loopback_channel or "ai2"]
        options = {"rate_hz": s.sample_rate_hz, "range_v": s.range_v, "buffer_samples": 160_000, **changes}
        return card.open_input(options.pop("channels", channels), **options)  # type: ignore[arg-type]

    return opened


@pytest.fixture
def open_output(card: Card, rig: RigFile) -> Callable[..., CardOutput]:
    def opened(volts: np.ndarray, **changes: object) -> CardOutput:
        s = rig.card
        options = {"rate_hz": s.sample_rate_hz, "range_v": s.range_v, **changes}
        return card.open_output(s.command_channel, volts, **options)  # type: ignore[arg-type]

    return opened


def way_v(rig: RigFile, step_mm: float, speed_mm_s: float = 5.0) -> np.ndarray:
    """From the safe position a step away, in volts."""
    c = rig.calibration.nominal()
    safe_mm = rig.lever.safe_position_mm
    way = straight_mm(safe_mm, safe_mm + step_mm, speed_mm_s=speed_mm_s, rate_hz=rig.card.sample_rate_hz)
    return way * c.command_volts_per_mm + c.command_zero_v


@pytest.fixture
def at_safety(card: Card, rig: RigFile) -> None:
    bring_to_safety(card, rig.card, rig.lever, rig.calibration.nominal())


def needs_loopback(rig: RigFile) -> None:
    if rig.card.loopback_channel is None:
        pytest.skip("card.loopback_channel is not in the rig file: the command can't be read back")


def test_samples_come_channel_by_channel_and_in_order(open_input: Callable[..., CardInput]) -> None:
    with closing(open_input()) as source:
        source.start()
        first = source.read(80, timeout_s=2.0).copy()
        second = source.read(41, timeout_s=2.0)
        assert first.shape == (3, 80)
        assert second.shape == (3, 41)
        assert np.all(np.isfinite(first))
        assert source.acquired() >= 121


def test_samples_come_at_the_rate_asked_for(rig: RigFile, open_input: Callable[..., CardInput]) -> None:
    with closing(open_input()) as source:
        source.start()
        source.read(80, timeout_s=2.0)
        before_s, before, after_before_s = time.monotonic(), source.acquired(), time.monotonic()
        time.sleep(0.5)
        end_s, n, after_end_s = time.monotonic(), source.acquired() - before, time.monotonic()
        # the two answers were given somewhere within the two calls
        assert 0.98 * (end_s - after_before_s) < n / rig.card.sample_rate_hz < 1.02 * (after_end_s - before_s)
        assert source.available() > 0


def test_a_rate_the_card_would_change_is_refused(open_input: Callable[..., CardInput]) -> None:
    with pytest.raises(RateCoercedError, match=r"asked for 8001\.3"):
        open_input(rate_hz=8001.3)
    with closing(open_input()):
        pass  # the refused task has freed the card


@pytest.mark.parametrize(("channels", "code"), [(["ai77"], -200170), (["ai0", "ai99"], -200170)])
def test_no_such_channel(open_input: Callable[..., CardInput], channels: list[str], code: int) -> None:
    with pytest.raises(CardMissingError, match=str(code)) as caught:
        open_input(channels=channels)
    assert caught.value.code == code


def test_no_such_device(address: str) -> None:
    with Card(address, "NoSuchDev") as nowhere, pytest.raises(CardMissingError) as caught:
        nowhere.open_input(["ai0"], rate_hz=8000.0, range_v=10.0, buffer_samples=8000)
    assert caught.value.code == -200220
    assert "\n" not in str(caught.value)


def test_a_card_in_use_is_refused(
    rig: RigFile, address: str, card: Card, open_input: Callable[..., CardInput]
) -> None:
    options = {"rate_hz": rig.card.sample_rate_hz, "range_v": rig.card.range_v, "buffer_samples": 8000}
    with closing(open_input()) as source:
        source.start()
        with Card(address, rig.card.device, owner="somebody else") as other:
            with (
                pytest.raises(CardBusyError) as caught,
                closing(other.open_input(["ai0", "ai1"], **options)) as second,
            ):
                second.start()
            assert caught.value.code == -50103
        with pytest.raises(CardBusyError):
            card.open_input(["ai0", "ai1"], **options)
        assert source.read(8, timeout_s=2.0).shape == (3, 8)


def test_samples_not_yet_there_are_told_with_their_count(open_input: Callable[..., CardInput]) -> None:
    with closing(open_input()) as source:
        source.start()
        with pytest.raises(SamplesLateError) as caught:
            source.read(8000, timeout_s=0.05)
        assert caught.value.code == -200284
        assert caught.value.samples_done is not None
        assert 0 <= caught.value.samples_done < 8000


def test_samples_overwritten_are_told(open_input: Callable[..., CardInput]) -> None:
    with closing(open_input(buffer_samples=800)) as source:
        source.start()
        source.read(8, timeout_s=2.0)
        time.sleep(0.6)
        with pytest.raises(SamplesLostError) as caught:
            for _ in range(200):
                source.read(8, timeout_s=1.0)
        assert caught.value.code == -200279


@pytest.mark.usefixtures("at_safety")
def test_a_waveform_is_played_once_and_its_end_is_held(
    rig: RigFile, open_input: Callable[..., CardInput], open_output: Callable[..., CardOutput]
) -> None:
    needs_loopback(rig)
    volts = way_v(rig, STEP_MM)
    with closing(open_input()) as source, closing(open_output(volts)) as output:
        source.start()
        before = source.read(80, timeout_s=2.0)[2].copy()
        output.start()
        n_read = 80
        while not output.done():
            source.read(80, timeout_s=5.0)
            n_read += 80
        assert output.generated() == len(volts)
        source.read(source.acquired() - n_read + 8, timeout_s=5.0)
        after = source.read(800, timeout_s=5.0)[2]
        assert before == pytest.approx(volts[0], abs=0.01)
        assert after == pytest.approx(volts[-1], abs=0.01)


@pytest.mark.usefixtures("at_safety")
def test_an_output_closed_on_its_way_keeps_its_voltage(
    rig: RigFile, open_input: Callable[..., CardInput], open_output: Callable[..., CardOutput]
) -> None:
    needs_loopback(rig)
    volts = way_v(rig, STEP_MM, speed_mm_s=0.1)
    with closing(open_input()) as source:
        source.start()
        source.read(80, timeout_s=2.0)
        n_read = 80
        output = open_output(volts)
        output.start()
        # a busy computer has a backlog of input to read before the output has moved at all
        while output.generated() < len(volts) // 4:
            source.read(80, timeout_s=2.0)
            n_read += 80
        output.close()
        source.read(source.acquired() - n_read + 8, timeout_s=5.0)
        held = source.read(400, timeout_s=2.0)[2].copy()
    assert volts[0] + 0.005 < held.mean() < volts[-1] - 0.005
    assert np.ptp(held) < 0.01


@pytest.mark.usefixtures("at_safety")
def test_a_common_trigger_starts_command_and_recording_on_one_sample(rig: RigFile, address: str) -> None:
    c = rig.calibration.nominal()
    with Lever(rig, address, c) as lever:
        lever.retreat()
        waveform = straight_mm(
            lever.commanded_mm, lever.commanded_mm + STEP_MM, speed_mm_s=5.0, rate_hz=lever.sample_rate_hz
        )
        chunk, playback = lever.record_once(waveform, tail_s=0.05)
        assert chunk.start == 0
        assert playback.started_sample == 0
        assert chunk.command_mm[: playback.n] == pytest.approx(waveform, abs=0.005)
        assert chunk.position_mm[-80:] == pytest.approx(waveform[-1], abs=rig.lever.following_error_max_mm)


@pytest.mark.usefixtures("at_safety")
def test_tasks_left_by_the_dead_are_cleared(rig: RigFile, address: str) -> None:
    if not address:
        pytest.skip("a driver in this computer frees a process's tasks with the process")
    left = Card(address, rig.card.device)
    source = left.open_input(["ai0", "ai1"], rate_hz=8000.0, range_v=10.0, buffer_samples=8000)
    source.start()
    output = left.open_output("ao0", way_v(rig, STEP_MM, speed_mm_s=0.1), rate_hz=8000.0, range_v=10.0)
    output.start()
    with Card(address, rig.card.device) as card:
        done = bring_to_safety(card, rig.card, rig.lever, rig.calibration.nominal())
    assert done.to_mm == pytest.approx(rig.lever.safe_position_mm, abs=rig.lever.following_error_max_mm)
    with pytest.raises(CardError):
        source.read(8, timeout_s=1.0)
    left.close()


def test_a_server_that_is_not_there_is_told_in_one_line() -> None:
    with (
        Card("127.0.0.1:9", "Dev1") as card,
        pytest.raises(CardMissingError, match="does not answer") as caught,
    ):
        card.open_input(["ai0"], rate_hz=8000.0, range_v=10.0, buffer_samples=8000)
    assert "\n" not in str(caught.value)


def test_without_a_driver_the_card_in_this_computer_is_missing() -> None:
    with Card("", "NoSuchDev") as card, pytest.raises(CardMissingError) as caught:
        card.open_input(["ai0"], rate_hz=8000.0, range_v=10.0, buffer_samples=8000)
    assert "\n" not in str(caught.value)
