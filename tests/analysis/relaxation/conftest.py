"""A small simulator of its own: exact tissue, exact servo, chosen noise; every true value known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.recordings.trial import (
    Calibration,
    NativeSamples,
    Phase,
    ProtocolSummary,
    Specimen,
    Surface,
    Trial,
)
from analysis.relaxation.motion import servo_answer
from analysis.relaxation.response import arm_response, force_response

RATE_HZ = 8000.0
FINER = 2  # the truth is computed on a finer grid than it is sampled
TRUTH = {"k0": 120.0, "A1_over_A0": 0.371, "A2_over_A0": 0.294, "t1_s": 2.279, "t2_s": 0.149}


def simulate_trial(
    depth_mm: float = 0.4,
    *,
    seed: int = 0,
    noise_mn: float = 0.3,
    correlation_s: float | None = None,
    position_noise_mm: float = 2.5e-4,
    hold_s: float = 7.0,
    dwell_s: float = 2.0,
    ramp_mm_s: float = 5.0,
    short_mm: float = 0.3,
    preload_mm: float = 0.066,
    offset_mn: float = 0.0,
    with_command: bool = True,
    arms: tuple[tuple[float, float], ...] = ((0.371, 2.279), (0.294, 0.149)),
    k0: float = 120.0,
    clear_s: float = 0.0,
    finger: str = "index",
    repeat: int = 1,
) -> Trial:
    """Return a trial; ``arms`` are (stiffness over k0, time).

    With ``correlation_s`` a quarter of the noise's variance is slow.
    """
    rng = np.random.default_rng(seed)
    contact_mm = 4.0 + rng.uniform(0, 1e-3)
    legs = [(0.2, 0.0), (short_mm + preload_mm, 1.0), (dwell_s, 0.0), (depth_mm, ramp_mm_s), (hold_s, 0.0)]
    if clear_s:
        legs += [(depth_mm + preload_mm + short_mm, -5.0), (clear_s, 0.0)]
    times, places, marks = [0.0], [contact_mm - short_mm], []
    for amount, speed in legs:
        times.append(times[-1] + (amount / abs(speed) if speed else amount))
        places.append(places[-1] + (np.sign(speed) * amount if speed else 0.0))
        marks.append(times[-1])
    n = int(times[-1] * RATE_HZ)
    fine_s = np.arange((n - 1) * FINER + 1) / (RATE_HZ * FINER)
    motion_mm = servo_answer(np.interp(fine_s, times, places), 1 / (RATE_HZ * FINER))
    depth = np.maximum(motion_mm - contact_mm, 0.0)
    force = force_response(depth, 1 / (RATE_HZ * FINER), k0, [(share * k0, tau) for share, tau in arms])[
        ::FINER
    ]
    error = rng.normal(size=n) * noise_mn
    if correlation_s is not None:
        decay = np.exp(-1 / (RATE_HZ * correlation_s))
        slow = lfilter([np.sqrt(1 - decay**2)], [1, -decay], rng.normal(size=n + 16000))[16000:]
        error = error * np.sqrt(0.75) + 0.5 * noise_mn * slow
    samples = [int(np.ceil(mark * RATE_HZ - 1e-6)) for mark in marks]
    samples[-1] = n
    names = ("approach", "dwell", "ramp", "hold", "retract", "clear")
    bounds = [0, *samples[1:]]
    phases = tuple(Phase(*row) for row in zip(names, bounds[:-1], bounds[1:], strict=False))
    position_mm = motion_mm[::FINER] + rng.normal(size=n) * position_noise_mm
    command_mm = np.interp(np.arange(n) / RATE_HZ, times, places)
    return Trial(
        trial_id=f"{seed}-{depth_mm}",
        started="2026-01-31T12:00:00+01:00",
        kind="ramp_hold_retract",
        source="simulated",
        status="complete",
        sample_rate_hz=RATE_HZ,
        position_v=position_mm * 2.042 - 10.0,
        force_v=(force + offset_mn + error) * 0.015,
        command_v=command_mm * 2.042 - 10.0 if with_command else None,
        calibration=Calibration(2.042, -10.0, 0.015, 0.0, 2.042, -10.0),
        phases=phases,
        surface=Surface(contact_mm + preload_mm, samples[1], 5.0, 10.0),
        protocol=ProtocolSummary(depth_mm=depth_mm, ramp_speed_mm_s=ramp_mm_s, hold_s=hold_s),
        specimen=Specimen(subject="s1", finger=finger, repeat=repeat),
    )


def simulate_convex(
    exponent: float = 1.5,
    *,
    rate_hz: float = 100.0,
    seed: int = 0,
    depth_mm: float = 0.4,
    ramp_s: float = 0.1,
    hold_s: float = 7.0,
    times_s: tuple[float, float] = (2.279, 0.149),
    shares: tuple[float, float] = (0.371, 0.294),
    k0: float = 120.0,
    signal_to_noise: float = 200.0,
    uneven: bool = False,
) -> Trial:
    """Return a trial of another laboratory: no servo, any rate, a punch whose force grows as depth^exponent.

    It begins at rest 0.3 mm in the air, at an instant that falls between two samples.
    """
    rng = np.random.default_rng([41, seed])
    air_mm, start_s = 0.3, 1.0 + float(rng.uniform(0.0, 1.0 / rate_hz))
    touch_s = start_s + air_mm * ramp_s / depth_mm
    corners_s = [0.0, start_s, touch_s + ramp_s, touch_s + ramp_s + hold_s]
    places_mm = [0.0, 0.0, air_mm + depth_mm, air_mm + depth_mm]
    n = int(corners_s[-1] * rate_hz)
    time_s = np.arange(n) / rate_hz
    if uneven:
        time_s = time_s + rng.uniform(-0.3, 0.3, n) / rate_hz
        time_s -= time_s[0]
    fine_s = np.unique(np.concatenate([time_s, corners_s[1:3], np.linspace(touch_s, touch_s + ramp_s, 4001)]))
    depth = np.maximum(np.interp(fine_s, corners_s, places_mm) - air_mm, 0.0)
    level = depth_mm * (depth / depth_mm) ** exponent
    force = k0 * level
    for share, tau_s in zip(shares, times_s, strict=True):
        force = force + share * k0 * arm_response(level, fine_s, tau_s)
    force_mn = np.interp(time_s, fine_s, force)
    force_mn = force_mn + rng.normal(size=n) * force_mn.max() / signal_to_noise
    position_mm = np.interp(time_s, corners_s, places_mm)
    marks = [0, *(int(np.ceil(at * rate_hz)) for at in corners_s[1:3]), n]
    phases = tuple(
        Phase(*row) for row in zip(("approach", "ramp", "hold"), marks[:-1], marks[1:], strict=True)
    )
    return Trial(
        trial_id=f"convex-{seed}",
        started="2026-01-31T12:00:00+01:00",
        kind="ramp_hold_retract",
        source="imported",
        status="complete",
        sample_rate_hz=rate_hz,
        position_v=position_mm,
        force_v=force_mn,
        command_v=None,
        calibration=Calibration(1.0, 0.0, 1.0, 0.0, 1.0, 0.0),
        phases=phases,
        native=NativeSamples(time_s, position_mm, force_mn) if uneven else None,
        path=f"convex-{seed}.h5",
    )


def with_force(trial: Trial, force_mn: np.ndarray) -> Trial:
    """Return the trial with another force."""
    return replace(trial, force_v=force_mn * trial.calibration.volts_per_mn + trial.calibration.force_zero_v)


@pytest.fixture(scope="session")
def simulate() -> Callable[..., Trial]:
    """Function that simulates a trial; see `simulate_trial`."""
    return simulate_trial


@pytest.fixture(scope="session")
def convex() -> Callable[..., Trial]:
    """Function that simulates a trial of another laboratory; see `simulate_convex`."""
    return simulate_convex


@pytest.fixture(scope="session")
def forced() -> Callable[[Trial, Any], Trial]:
    """Function (trial, force in mN) -> the trial with that force."""
    return with_force


@pytest.fixture(scope="session")
def truth() -> dict[str, float]:
    """The true values of the default tissue."""
    return TRUTH
