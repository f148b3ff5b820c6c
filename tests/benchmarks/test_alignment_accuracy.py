"""Command against position and force, to the sample: by loop-back, and where the start is merely expected.

`pytest -m benchmark -s tests/benchmarks/test_alignment_accuracy.py`
"""

from __future__ import annotations

import numpy as np
import pytest

from rig.hardware.companion import Companion
from rig.hardware.lever import Lever
from rig.hardware.remote import ControlService
from rig.hardware.retreat import straight_mm
from rig.settings.reading import parse_rig

BENCH = """
[card]
address = "companion:card"
loopback_channel = "ai2"
[companion]
command = ["{python}", "-m", "sim_hardware"]
[companion.settings]
seed = 5
loopback_wired = true
"""


def played(
    lever: Lever, to_mm: float, speed_mm_s: float, late: int, control: ControlService
) -> tuple[int, int, int]:
    """Play one way; the true start by the loop-back's own best fit, the one found and the one expected."""
    control.call("fault", "late_start", {"samples": late})
    way_mm = straight_mm(lever.commanded_mm, to_mm, speed_mm_s=speed_mm_s, rate_hz=lever.sample_rate_hz)
    playback = lever.play(way_mm)
    chunks = [lever.read(1)]
    while not playback.done:
        chunks.append(lever.read(80))
    chunks.append(lever.read(late + 80))
    command_v = np.concatenate([chunk.command_v for chunk in chunks])
    first = chunks[0].start
    # an exhaustive search over every place in everything recorded: what the finder must agree with
    windows = np.lib.stride_tricks.sliding_window_view(command_v, playback.n)
    misfit = [float(np.mean((window - playback.volts) ** 2)) for window in windows]
    found = playback.started_sample
    assert found is not None
    return int(np.argmin(misfit)) + first, found, playback.expected_sample


@pytest.mark.benchmark
@pytest.mark.parametrize("time", ["virtual", "real"])
def test_alignment_with_late_starts(time: str) -> None:
    rig = parse_rig(BENCH + f'time = "{time}"\n', "bench")
    assert rig.companion is not None
    rng = np.random.default_rng(7)
    found_off: list[int] = []
    expected_off: list[int] = []
    with Companion(rig.companion) as companion:
        control = ControlService(companion.resolve("companion:control"))
        control.call("request", "clear_air", {})
        with Lever(rig, companion.resolve(rig.card.address), rig.calibration.nominal()) as lever:
            lever.retreat()
            lever.start_recording()
            for i in range(120 if time == "virtual" else 40):
                late = 0 if i % 2 else int(rng.integers(1, 400))
                to_mm = float(rng.uniform(1.0, 9.0))
                while abs(to_mm - lever.commanded_mm) < 0.2:
                    to_mm = float(rng.uniform(1.0, 9.0))
                true, found, expected = played(lever, to_mm, float(rng.uniform(2.0, 40.0)), late, control)
                found_off.append(found - true)
                expected_off.append(expected - true)
        control.close()
    by_loopback, as_expected = np.abs(found_off), np.abs(expected_off)
    prompt = as_expected[1::2]
    print(
        f"\n{len(by_loopback)} motions in {time} time, every other one up to 400 samples late:\n"
        f"  by loop-back off by at most {by_loopback.max()} samples, {np.mean(by_loopback == 0):.0%} exact\n"
        f"  taken as expected off by at most {as_expected.max()}, of those not late median "
        f"{np.median(prompt):.0f}, at most {prompt.max()}"
    )
    assert by_loopback.max() == 0
