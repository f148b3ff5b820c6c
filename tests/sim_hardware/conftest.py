"""A bench without noise, and motions played into it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest

from sim_hardware.parts import SAMPLE_RATE_HZ, FloatArray
from sim_hardware.settings import BenchSettings
from sim_hardware.world import World

QUIET = """
[specimens]
published_tissue = true
[noise]
force_mn_rms = 0.0
position_um_rms = 0.0
[converters]
bits = 0
offset_mv_rms = 0.0
"""


@dataclass(frozen=True)
class Played:
    """What a motion gave: true units, and where its phases are."""

    world: World
    position_mm: FloatArray
    force_mn: FloatArray
    phases: dict[str, slice]

    def force(self, phase: str) -> FloatArray:
        return self.force_mn[self.phases[phase]]

    def position(self, phase: str) -> FloatArray:
        return self.position_mm[self.phases[phase]]


def line(start_mm: float, stop_mm: float, speed_mm_s: float) -> FloatArray:
    """Command of a straight line, samples after now."""
    n = max(round(abs(stop_mm - start_mm) / speed_mm_s * SAMPLE_RATE_HZ), 1)
    return start_mm + (stop_mm - start_mm) * np.arange(1, n + 1) / n


def hold(at_mm: float, duration_s: float) -> FloatArray:
    return np.full(round(duration_s * SAMPLE_RATE_HZ), at_mm)


def volts(world: World, command_mm: FloatArray) -> FloatArray:
    c = world.constants
    return c.command_zero_v + c.command_volts_per_mm * command_mm


def play(world: World, parts: Sequence[tuple[str, FloatArray]]) -> Played:
    """Play named pieces of a command in mm."""
    readings = world.advance(volts(world, np.concatenate([p for _, p in parts])))
    c = world.constants
    phases, start = {}, 0
    for name, piece in parts:
        phases[name] = slice(start, start + len(piece))
        start += len(piece)
    return Played(
        world,
        (readings.position_v - c.position_zero_v) / c.volts_per_mm,
        (readings.force_v - c.force_zero_v) / c.volts_per_mn,
        phases,
    )


def trial_parts(
    surface_mm: float, depth_mm: float = 0.6, hold_s: float = 3.0
) -> list[tuple[str, FloatArray]]:
    """A published trial whose dwell is 0.06 mm deep, from 0.4 mm short of the surface."""
    short, touch, deep = surface_mm - 0.4, surface_mm + 0.06, surface_mm + 0.06 + depth_mm
    return [
        ("approach", np.concatenate([hold(short, 0.1), line(short, touch, 1.0)])),
        ("dwell", hold(touch, 2.0)),
        ("ramp", line(touch, deep, 5.0)),
        ("hold", hold(deep, hold_s)),
        ("retract", line(deep, short, 5.0)),
        ("clear", hold(short, 0.5)),
    ]


def play_trial(
    settings: BenchSettings,
    *,
    depth_mm: float = 0.6,
    trials: int = 1,
    rest_s: float = 20.0,
    hold_s: float = 3.0,
) -> list[Played]:
    """Play the same trial at new sites of a finger on one bench."""
    world = World(settings)
    played = []
    for i in range(trials):
        park = float(world.arm().position_mm)
        world.advance(volts(world, line(park, 1.0, 20.0)))
        world.rest(rest_s)
        world.request("place_finger", {"finger": "index", "site": f"s{i}", "repeat": 1})
        surface_mm = world.specimen.surface_mm
        world.advance(
            volts(world, np.concatenate([line(1.0, surface_mm - 0.4, 20.0), hold(surface_mm - 0.4, 0.2)]))
        )
        world.begin_trial()
        played.append(play(world, trial_parts(surface_mm, depth_mm, hold_s)))
    return played


@pytest.fixture(scope="session")
def quiet() -> Callable[..., BenchSettings]:
    """Function (more TOML, seed) -> settings of a bench without noise and with ideal converters."""

    def make(more: str = "", seed: int = 5) -> BenchSettings:
        return BenchSettings.from_toml(f"seed = {seed}\n{QUIET}\n{more}")

    return make


@pytest.fixture(scope="session")
def bench() -> type:
    """The helpers of this file."""

    class Bench:
        line = staticmethod(line)
        hold = staticmethod(hold)
        volts = staticmethod(volts)
        play = staticmethod(play)
        play_trial = staticmethod(play_trial)
        trial_parts = staticmethod(trial_parts)

    return Bench
