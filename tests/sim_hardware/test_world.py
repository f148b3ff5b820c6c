"""The world's physics against what is published, and against itself in blocks and jumps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_hardware.effects import EFFECTS
from sim_hardware.settings import BenchSettings
from sim_hardware.world import World
from sim_hardware.world.converters import Converter

ALL_EFFECTS = "".join(f'[[effects]]\nname = "{name}"\n' for name in EFFECTS)
NOISY = (
    "seed = 7\n[noise]\ncorrelated_share = 0.5\nwander_mn_rms = 1.0\ngain_jitter = 0.01\n"
    '[[effects]]\nname = "support_resonance"\n' + ALL_EFFECTS
)


def _touching(bench: Any, settings: BenchSettings) -> tuple[World, np.ndarray]:
    """Return a world with a finger, and the command of a short trial on it."""
    world = World(settings)
    world.request("place_finger", {"finger": "middle", "site": "a", "repeat": 1})
    surface_mm = world.specimen.surface_mm
    start = world.arm().position_mm
    parts = [
        bench.line(start, surface_mm - 0.3, 20.0),
        *(p for _, p in bench.trial_parts(surface_mm, 0.4, 0.3)),
    ]
    parts[2] = parts[2][:2000]  # a shorter dwell
    return world, bench.volts(world, np.concatenate(parts))


@given(st.lists(st.integers(min_value=1, max_value=8000), min_size=1, max_size=12))
@settings(max_examples=8, deadline=None)
def test_blocks_of_any_size_give_the_same_volts(bench: Any, sizes: list[int]) -> None:
    """Bit for bit, noise and every effect at once included."""
    bench_settings = BenchSettings.from_toml(NOISY)
    world, command = _touching(bench, bench_settings)
    whole = world.advance(command)
    world, _ = _touching(bench, bench_settings)
    at, turn, pieces = 0, 0, []
    while at < len(command):
        n = sizes[turn % len(sizes)] if turn < 200 else 8000
        pieces.append(world.advance(command[at : at + n]))
        at, turn = at + n, turn + 1
    assert np.array_equal(whole.force_v, np.concatenate([p.force_v for p in pieces]))
    assert np.array_equal(whole.position_v, np.concatenate([p.position_v for p in pieces]))


def test_the_future_does_not_reach_back(bench: Any, quiet: Any) -> None:
    world, command = _touching(bench, quiet())
    first = world.advance(command)
    world, command = _touching(bench, quiet())
    command[9000:] += 0.5
    other = world.advance(command)
    assert np.array_equal(first.force_v[:9000], other.force_v[:9000])
    assert not np.array_equal(first.position_v[9000:], other.position_v[9000:])


def test_step_of_the_lever_takes_as_long_as_the_data_sheet_says(bench: Any, quiet: Any) -> None:
    """Critically damped: 1 to 99 % in 1.3 ms."""
    world = World(quiet())
    start = world.arm().position_mm
    played = bench.play(world, [("step", bench.hold(start + 0.001, 0.01))])
    rise = (played.position_mm - start) / 0.001
    t = np.arange(1, len(rise) + 1) / 8000
    # the command itself rises over the first sample, as the output does between two of its samples
    took_s = np.interp(0.99, rise, t) - np.interp(0.01, rise, t)
    assert took_s == pytest.approx(1.3e-3, rel=0.06)
    assert rise.max() < 1 + 1e-9
    assert rise[-1] == pytest.approx(1.0, abs=1e-9)


def test_lever_lags_behind_a_ramp_by_two_over_the_frequency(bench: Any, quiet: Any) -> None:
    world = World(quiet())
    start = world.arm().position_mm
    played = bench.play(world, [("ramp", bench.line(start, start + 1.0, 5.0))])
    command = bench.line(start, start + 1.0, 5.0)
    assert np.allclose(command[200:] - played.position_mm[200:], 5.0 * 2 / 5.0e3, atol=1e-9)


def test_relaxation_is_the_published_one(bench: Any, quiet: Any) -> None:
    """In the hold F = k0 d + two exponentials; A1 and A2 follow from the ramp's duration in closed form."""
    (played,) = bench.play_trial(quiet(), depth_mm=0.6, hold_s=7.0)
    force = played.force("hold")[400:]
    t = 0.05 + np.arange(1, len(force) + 1) / 8000
    k0, T, v = 120.0, 0.6 / 5, 5.0
    expected = k0 * 0.66
    for k, tau in ((0.371 * k0, 2.279), (0.294 * k0, 0.149)):
        ramp = k * v * tau * (1 - np.exp(-T / tau)) * np.exp(-t / tau)
        landed = k * 1.0 * tau * (1 - np.exp(-0.06 / tau)) * np.exp(-(t + T + 2.0) / tau)
        expected = expected + ramp + landed
    # the lever comes later than its command by 0.4 ms, no more
    assert np.max(np.abs(force - expected)) < 0.05


def test_ten_millinewtons_are_0_05_to_0_08_mm(bench: Any, quiet: Any) -> None:
    (played,) = bench.play_trial(quiet())
    force, position = played.force("approach"), played.position("approach")
    depth = position - played.world.specimen.surface_mm
    at_10 = float(np.interp(10.0, force[depth > 0], depth[depth > 0]))
    assert 0.045 < at_10 < 0.08


@given(st.floats(0.1, 3.0), st.integers(0, 2**16))
@settings(max_examples=5, deadline=None)
def test_linear_tissue_answers_in_proportion(bench: Any, quiet: Any, factor: float, seed: int) -> None:
    """In contact throughout, twice the motion is twice the change of force."""
    rng = np.random.default_rng(seed)
    wiggle = np.cumsum(rng.standard_normal(4000))
    wiggle *= 0.05 / np.abs(wiggle).max()
    forces = []
    for scale in (0.0, 1.0, factor):
        world = World(quiet(seed=seed))
        world.request("place_finger", {"finger": "ring", "site": "x", "repeat": 1})
        deep = world.specimen.surface_mm + 0.5
        world.advance(bench.volts(world, bench.line(world.arm().position_mm, deep, 20.0)))
        forces.append(bench.play(world, [("wiggle", deep + scale * wiggle)]).force_mn)
    assert np.allclose(forces[2] - forces[0], factor * (forces[1] - forces[0]), atol=1e-6)


def test_no_work_is_won_from_the_tissue(bench: Any, quiet: Any) -> None:
    """Around a closed path in and out of contact the punch does work on the tissue, never the reverse."""
    for effects in ("", '[[effects]]\nname = "stiffening"', '[[effects]]\nname = "adhesion"'):
        (played,) = bench.play_trial(quiet(effects))
        work = np.cumsum(played.force_mn[1:] * np.diff(played.position_mm))
        assert work[-1] > 0
        assert work.min() > -1e-3


def test_force_is_never_below_zero_without_adhesion(bench: Any, quiet: Any) -> None:
    (played,) = bench.play_trial(quiet())
    assert played.force_mn.min() > -1e-9
    assert np.all(np.abs(played.force("clear")) < 1e-9)


def test_the_surface_left_behind_creeps_back(bench: Any, quiet: Any) -> None:
    """A second touch right after the first finds the surface lower; after a rest it is back."""
    found = []
    for rest_s in (0.0, 30.0):
        world = World(quiet())
        world.request("place_finger", {"finger": "index", "site": "x", "repeat": 1})
        z = world.specimen.surface_mm
        go = [
            bench.line(world.arm().position_mm, z - 0.1, 20.0),
            bench.line(z - 0.1, z + 0.6, 5.0),
            bench.hold(z + 0.6, 3.0),
            bench.line(z + 0.6, z - 0.1, 20.0),
        ]
        world.advance(bench.volts(world, np.concatenate(go)))
        world.rest(rest_s)
        again = bench.play(world, [("again", bench.line(z - 0.1, z + 0.5, 1.0))])
        touch = int(np.flatnonzero(again.force_mn > 0.5)[0])
        found.append(float(again.position_mm[touch]) - z)
    assert found[0] > 0.02
    assert 0 < found[1] < 0.005


@pytest.mark.parametrize("where", ["pressed", "left"])
@pytest.mark.parametrize(
    "effects", ["", "glue_creep", "lever_compliance", "power_law_relaxation", "stiffening"]
)
def test_rest_is_what_waiting_does(bench: Any, quiet: Any, where: str, effects: str) -> None:
    more = f'[[effects]]\nname = "{effects}"' if effects else ""
    after = []
    for jump in (True, False):
        world = World(quiet(more))
        world.request("place_finger", {"finger": "index", "site": "x", "repeat": 1})
        z = world.specimen.surface_mm
        go = [bench.line(world.arm().position_mm, z, 20.0), bench.line(z, z + 0.5, 5.0)]
        if where == "left":
            go += [bench.hold(z + 0.5, 0.5), bench.line(z + 0.5, z - 0.2, 5.0)]
        command = bench.volts(world, np.concatenate(go))
        world.advance(command)
        if jump:
            world.rest(4.0)
        else:
            world.advance(np.full(32000, command[-1]))
        before = world.arm()
        again = bench.play(world, [("again", bench.line(before.position_mm, z + 0.7, 5.0))])
        after.append((before, again.force_mn))
    assert after[0][0].time_s == after[1][0].time_s
    assert after[0][0].force_mn == pytest.approx(after[1][0].force_mn, abs=2e-3)
    assert after[0][0].tip_mm == pytest.approx(after[1][0].tip_mm, abs=1e-6)
    assert np.max(np.abs(after[0][1] - after[1][1])) < 5e-3


def test_a_finer_step_changes_nothing_that_matters(bench: Any) -> None:
    forces = []
    for substeps in (4, 32):
        text = (
            f"seed = 5\nsubsteps = {substeps}\n[specimens]\npublished_tissue = true\n"
            "[noise]\nforce_mn_rms = 0.0\n[converters]\nbits = 0\n"
            '[[effects]]\nname = "adhesion"\n[[effects]]\nname = "lever_compliance"\n'
        )
        (played,) = bench.play_trial(BenchSettings.from_toml(text), hold_s=0.5)
        forces.append(played.force_mn)
    off = np.abs(forces[0] - forces[1])
    assert np.sqrt(np.mean(off**2)) < 0.03  # a tenth of the noise; the snap itself lasts a few samples
    assert np.median(off) < 2e-3


def test_a_new_site_is_fresh_tissue(bench: Any, quiet: Any) -> None:
    first, second = bench.play_trial(quiet(), trials=2, rest_s=0.0)
    n = min(len(first.force_mn), len(second.force_mn))
    assert np.allclose(first.force_mn[:n], second.force_mn[:n], atol=0.02)


def test_stiff_block_answers_as_a_spring(bench: Any, quiet: Any) -> None:
    world = World(quiet())
    world.request("place_block")
    z = world.specimen.surface_mm
    world.advance(bench.volts(world, bench.line(world.arm().position_mm, z - 0.01, 20.0)))
    played = bench.play(world, [("press", bench.line(z - 0.01, z + 0.01, 0.1))])
    inside = played.position_mm > z + 1e-4
    slope = np.polyfit(played.position_mm[inside], played.force_mn[inside], 1)[0]
    assert slope == pytest.approx(2.0e4, rel=1e-3)


def test_white_noise_is_as_large_as_said() -> None:
    world = World(BenchSettings.from_toml("seed = 3"))
    readings = world.advance(np.full(80000, -9.5))
    c = world.constants
    assert np.std(readings.force_v) / c.volts_per_mn == pytest.approx(0.3, rel=0.02)
    assert np.std(readings.position_v) / c.volts_per_mm == pytest.approx(0.25e-3, rel=0.05)
    white = readings.force_v - readings.force_v.mean()
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.02


def test_ugly_noise_is_ugly() -> None:
    text = "seed = 3\n[noise]\ncorrelated_share = 1.0\ncorrelation_ms = 2.0"
    world = World(BenchSettings.from_toml(text))
    force = world.advance(np.full(160000, -9.5)).force_v / world.constants.volts_per_mn
    force -= force.mean()
    assert np.std(force) == pytest.approx(0.3, rel=0.1)
    assert np.corrcoef(force[16:], force[:-16])[0, 1] == pytest.approx(np.exp(-1), abs=0.06)
    gains = set()
    world = World(BenchSettings.from_toml("[noise]\ngain_jitter = 0.02"))
    for _ in range(5):
        world.request("clear_air")
        gains.add(world.noise.gain)
    assert len(gains) == 5


@given(st.lists(st.floats(-12, 12), min_size=1, max_size=50))
@settings(max_examples=50, deadline=None)
def test_converters_round_and_clip(values: list[float]) -> None:
    converter = Converter(BenchSettings().converters)
    step = 20 / 65536
    assert converter.step_v == step
    volts = np.array(values)
    read = converter.convert(volts)
    assert np.array_equal(read, converter.convert(read))
    assert np.all(read >= -10.0)
    assert np.all(read <= 10.0 - step)
    inside = np.abs(volts) < 10 - step
    assert np.all(np.abs(read - volts)[inside] <= step / 2 + 1e-12)


def test_readings_are_codes_of_the_converter() -> None:
    world = World(BenchSettings())
    codes = world.advance(np.full(100, -9.5)).force_v / (20 / 65536)
    assert np.allclose(codes, np.rint(codes), atol=1e-9)


@pytest.mark.parametrize("command", [np.array([np.nan]), np.zeros((2, 2)), np.array([np.inf])])
def test_a_command_that_is_none_is_refused(command: np.ndarray) -> None:
    with pytest.raises(ValueError, match="finite volts"):
        World(BenchSettings()).advance(command)


@pytest.mark.parametrize("duration", [-1.0, np.nan, np.inf])
def test_a_rest_that_is_none_is_refused(duration: float) -> None:
    with pytest.raises(ValueError, match="duration_s"):
        World(BenchSettings()).rest(duration)
