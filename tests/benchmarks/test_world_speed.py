"""Processor time of the simulated bench, against stepping lever and tissue with SciPy's integrator."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from sim_hardware.concealment.offline import record_study, study_plans
from sim_hardware.settings import BenchSettings
from sim_hardware.world import World

PUBLISHED_SAMPLES = 8.3e6


def _trial(world: World) -> np.ndarray:
    z = world.specimen.surface_mm

    def line(a: float, b: float, speed: float) -> np.ndarray:
        return np.linspace(a, b, int(abs(b - a) / speed * 8000) + 1)[1:]

    command = [line(z - 0.5, z + 0.06, 1), np.full(16000, z + 0.06), line(z + 0.06, z + 0.66, 5)]
    command += [np.full(56000, z + 0.66), line(z + 0.66, z - 0.5, 5)]
    c = world.constants
    return c.command_zero_v + c.command_volts_per_mm * np.concatenate(command)


def _scipy_s(command_mm: np.ndarray, surface_mm: float) -> float:
    """Seconds for the same trial as ordinary differential equations: lever, two arms, contact by max."""
    from scipy.integrate import solve_ivp

    t = np.arange(len(command_mm)) / 8000
    k0, k1, k2, tau1, tau2, wn = 120.0, 44.52, 35.28, 2.279, 0.149, 5.0e3

    def slopes(at: float, y: np.ndarray) -> list[float]:
        x, v, q1, q2 = y
        u = np.interp(at, t, command_mm)
        touching = x > surface_mm and k0 * (x - surface_mm) + q1 + q2 > 0
        rate = v if touching else 0.0
        return [v, wn**2 * (u - x) - 2 * wn * v, k1 * rate - q1 / tau1, k2 * rate - q2 / tau2]

    began = time.process_time()
    start = [command_mm[0], 0.0, 0.0, 0.0]
    solve_ivp(slopes, (0, t[-1]), start, t_eval=t, method="LSODA", rtol=1e-6, atol=1e-8, max_step=1e-3)
    return time.process_time() - began


@pytest.mark.benchmark
def test_published_study_in_seconds(capsys: Any) -> None:
    world = World(BenchSettings.from_toml("[specimens]\npublished_tissue = true"))
    world.request("place_finger", {"finger": "index", "site": "a", "repeat": 1})
    command = _trial(world)
    world.advance(command[:100])
    world.rest(1.0)
    rates = {}
    for block in (40, 8000):
        began = time.process_time()
        for at in range(0, len(command), block):
            world.advance(command[at : at + block])
        rates[block] = (time.process_time() - began) / len(command)
    c = world.constants
    theirs = _scipy_s((command - c.command_zero_v) / c.command_volts_per_mm, world.specimen.surface_mm)
    began = time.process_time()
    record_study(BenchSettings(), study_plans())
    study_s = time.process_time() - began
    whole_s = {block: rate * PUBLISHED_SAMPLES for block, rate in rates.items()}
    one_s = rates[8000] * len(command)
    with capsys.disabled():
        print(f"\nprocessor time of the published study's 8.3e6 samples, 4 steps each: {whole_s[8000]:.1f} s")
        print(f"in blocks of 40 samples: {whole_s[40]:.1f} s")
        print(f"one trial: {one_s * 1e3:.0f} ms; scipy solve_ivp {theirs:.1f} s", end="")
        print(f", {theirs / one_s:.0f} times as long")
        print(f"20 trials of 12 s recorded offline: {study_s:.1f} s")
    assert whole_s[8000] < 15
