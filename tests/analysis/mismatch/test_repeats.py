"""Repeats are trials whose arm was moved alike: what was stated and what was moved both count."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Calibration, Phase, ProtocolSummary, Trial

RATE_HZ = 1000.0


def pressed(
    depth_mm: float = 0.4,
    ramp_s: float = 0.1,
    hold_s: float = 2.0,
    retract_s: float = 0.1,
    *,
    rate_hz: float = RATE_HZ,
    waits_s: float = 0.5,
    protocol: ProtocolSummary | None = None,
    wobble_mm: float = 0.0,
) -> Trial:
    """Return a press, hold and release on a spring; the hold may wobble."""
    corners_s = np.cumsum([0.0, waits_s, ramp_s, hold_s, retract_s, 0.3])
    time_s = np.arange(int(corners_s[-1] * rate_hz)) / rate_hz
    position_mm = np.interp(time_s, corners_s, [0.0, 0.0, depth_mm, depth_mm, 0.0, 0.0])
    inside = (time_s > corners_s[2]) & (time_s < corners_s[3])
    position_mm = position_mm + inside * wobble_mm * np.sin(np.pi * (time_s - corners_s[2]) / hold_s)
    force_mn = 100.0 * position_mm + np.random.default_rng(0).normal(size=len(time_s)) * 0.1
    marks = [0, *(int(np.ceil(s * rate_hz - 1e-6)) for s in corners_s[1:5]), len(time_s)]
    names = ("approach", "ramp", "hold", "retract", "clear")
    return Trial(
        trial_id=f"{depth_mm}-{ramp_s}-{hold_s}-{retract_s}-{waits_s}-{rate_hz}",
        started="2026-01-31T12:00:00+01:00",
        kind="ramp_hold_retract",
        source="imported",
        status="complete",
        sample_rate_hz=rate_hz,
        position_v=position_mm,
        force_v=force_mn,
        command_v=None,
        calibration=Calibration(1.0, 0.0, 1.0, 0.0, 1.0, 0.0),
        phases=tuple(Phase(*row) for row in zip(names, marks[:-1], marks[1:], strict=True)),
        protocol=protocol or ProtocolSummary(),
    )


def conditions(trials: Sequence[Trial]) -> list[str]:
    # the order in which they were given, whatever their names
    dated = [replace(t, started=f"2026-01-31T12:{k:02d}:00+01:00") for k, t in enumerate(trials)]
    return [cells.condition for cells in take_in_memory(dated).trials]


@pytest.mark.parametrize(
    "other",
    [
        {"waits_s": 0.9},
        {"waits_s": 0.5004},  # the ramp begins between two samples
        {"depth_mm": 0.408},
        {"hold_s": 2.01},
        {"rate_hz": 700.0},
    ],
)
def test_what_was_moved_alike_is_a_repeat(other: dict[str, float]) -> None:
    first, second = conditions([pressed(), pressed(**other)])
    assert first == second


@pytest.mark.parametrize(
    "other",
    [
        {"ramp_s": 0.12},
        {"ramp_s": 0.13},
        {"depth_mm": 0.45},
        {"hold_s": 2.2},
        {"retract_s": 0.2},
        {"wobble_mm": 0.05},
    ],
)
@pytest.mark.parametrize("stated", [None, ProtocolSummary(depth_mm=0.4, ramp_speed_mm_s=4.0, hold_s=2.0)])
def test_different_motions_are_never_repeats(other: dict[str, float], stated: ProtocolSummary | None) -> None:
    first, again, second = conditions(
        [pressed(protocol=stated), pressed(protocol=stated, waits_s=0.6), pressed(protocol=stated, **other)]
    )
    assert first == again
    assert first != second


def test_ramps_sampled_slowly_are_repeats_wherever_the_samples_fell() -> None:
    """At 5 Hz a ramp of 1 s has five samples; where they fall differs from trial to trial."""
    alike = [pressed(2.0, 1.0, 100.0, 1.0, rate_hz=5.0, waits_s=2.0 + k * 0.05) for k in range(4)]
    other = pressed(2.0, 3.0, 100.0, 1.0, rate_hz=5.0, waits_s=2.0)
    *found, last = conditions([*alike, other])
    assert len(set(found)) == 1
    assert last not in found


def test_conditions_are_named_by_what_was_stated_or_measured() -> None:
    stated = ProtocolSummary(depth_mm=0.4, ramp_speed_mm_s=4.0, hold_s=2.0)
    assert conditions([pressed(protocol=stated)]) == ["ramp_hold_retract 0.4 mm 4 mm/s 2 s"]
    assert conditions([pressed(), pressed(retract_s=0.2)]) == [
        "ramp_hold_retract 0.4 mm 4 mm/s 2 s motion a",
        "ramp_hold_retract 0.4 mm 4 mm/s 2 s motion b",
    ]
