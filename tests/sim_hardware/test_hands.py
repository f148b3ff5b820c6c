"""The operator's hands: fingers, block, micrometer, weights; and the constants drawn per bench."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sim_hardware.settings import BenchSettings
from sim_hardware.world import World


def _force_mn(world: World) -> float:
    c = world.constants
    readings = world.advance(np.full(4000, world.arm().command_v))
    return float((readings.force_v.mean() - c.force_zero_v) / c.volts_per_mn)


def test_weights_hang_as_the_published_calibration_says(quiet: Any) -> None:
    """W + m g / 2, at an angle that is a little off; a gram weighs 9.80665 mN."""
    world = World(quiet("[lever]\narm_mass_g = 0.8"))
    world.request("invert_arm", {"inverted": True})
    level = np.cos(world.constants.hang_angle_error_rad)
    for mass_g in (0, 1, 5.0, 20.0):
        assert world.request("hang_weight", {"mass_g": mass_g})
        assert _force_mn(world) == pytest.approx((mass_g + 0.4) * 9.80665 * level, abs=1e-6)
    world.request("invert_arm", {"inverted": False})
    assert _force_mn(world) == pytest.approx(0.0, abs=1e-6)


def test_the_micrometer_lowers_the_block(quiet: Any) -> None:
    world = World(quiet())
    world.request("place_block")
    heights = []
    for position_um in range(0, 801, 160):
        world.request("turn_micrometer", {"position_um": position_um})
        heights.append(world.specimen.surface_mm)
    steps_um = np.diff(heights) * 1e3
    assert np.allclose(steps_um, 160, atol=1.0)
    assert not np.allclose(steps_um, 160, atol=1e-6)  # the screw has an error of its own
    world.request("turn_micrometer", {"position_um": 0})
    assert world.specimen.surface_mm == heights[0]


def test_every_site_has_a_height_and_a_stiffness_of_its_own() -> None:
    world = World(BenchSettings.from_toml("seed = 9"))
    heights, stiffness = [], {}
    for finger in ("thumb", "index", "middle", "ring", "little"):
        for site in ("a", "b", "c"):
            world.request("place_finger", {"finger": finger, "site": site, "repeat": 1})
            heights.append(world.specimen.surface_mm)
            stiffness.setdefault(finger, set()).add(world.specimen.parts.k0_mn_per_mm)
    assert len(set(heights)) == 15
    assert 3.0 <= min(heights) < max(heights) <= 6.0
    assert len(set.union(*stiffness.values())) == 15
    assert all(60 < k < 230 for s in stiffness.values() for k in s)


def test_published_tissue_switches_the_variation_off() -> None:
    world = World(BenchSettings.from_toml("[specimens]\npublished_tissue = true"))
    for finger in ("thumb", "little"):
        world.request("place_finger", {"finger": finger, "site": "a", "repeat": 2})
        assert world.specimen.parts.k0_mn_per_mm == 120.0


def test_the_same_labels_find_the_same_site() -> None:
    heights = set()
    for _ in range(2):
        world = World(BenchSettings.from_toml("seed = 4"))
        world.request("place_finger", {"finger": "ring", "site": "x", "repeat": 3})
        heights.add(world.specimen.surface_mm)
    assert len(heights) == 1


def test_true_constants_differ_from_the_nominal_ones_by_a_few_percent() -> None:
    drawn = [World(BenchSettings(seed=s)).constants for s in range(40)]
    for name, nominal in (("volts_per_mm", 2.042), ("volts_per_mn", 0.015), ("command_volts_per_mm", 2.042)):
        off = np.array([getattr(c, name) / nominal - 1 for c in drawn])
        assert 0.01 < off.std() < 0.03
        assert np.abs(off).max() < 0.06
    assert np.std([c.position_zero_v for c in drawn]) == pytest.approx(0.03, rel=0.5)


def test_truth_says_what_was_drawn() -> None:
    world = World(BenchSettings.from_toml('[[effects]]\nname = "slip"'))
    world.request("place_finger", {"finger": "index", "site": "a", "repeat": 1})
    truth = world.truth()
    assert truth["volts_per_mm"] == world.constants.volts_per_mm
    assert truth["surface_mm"] == world.specimen.surface_mm
    (effect,) = truth["effects"]  # type: ignore[misc]
    assert effect["name"] == "slip"
    assert set(effect["drawn"]) == {"time_s"}


@pytest.mark.parametrize(
    ("kind", "details", "words"),
    [
        ("dance", {}, "unknown"),
        ("place_finger", {"finger": "toe"}, "thumb"),
        ("place_finger", {"finger": "index", "color": 3}, "color"),
        ("place_finger", {"finger": "index", "repeat": "x"}, "repeat"),
        ("hang_weight", {"mass_g": 5.0}, "not inverted"),
        ("hang_weight", {"mass_g": -5.0}, "mass_g"),
        ("hang_weight", {}, "mass_g"),
        ("turn_micrometer", {"position_um": "far"}, "position_um"),
        ("turn_micrometer", {"position_um": float("nan")}, "position_um"),
        ("invert_arm", {"inverted": 1}, "true or false"),
    ],
)
def test_what_the_hands_can_not_do_is_one_line(kind: str, details: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words) as caught:
        World(BenchSettings()).request(kind, details)
    assert "\n" not in str(caught.value)


def test_no_finger_is_put_where_the_punch_is(bench: Any) -> None:
    world = World(BenchSettings())
    world.advance(bench.volts(world, bench.line(world.arm().position_mm, 8.0, 20.0)))
    with pytest.raises(ValueError, match="in the way"):
        world.request("place_finger", {"finger": "index", "site": "a", "repeat": 1})


def test_a_hand_puts_the_finger_about_where_it_is_asked() -> None:
    world = World(BenchSettings.from_toml("seed = 2"))
    heights = []
    for site in "abcdef":
        world.request("place_finger", {"finger": "index", "site": site, "repeat": 1, "surface_mm": 4.2})
        heights.append(world.specimen.surface_mm)
    assert np.allclose(heights, 4.2, atol=0.11)
    assert np.std(heights) > 0.01


@pytest.mark.parametrize("block", [16, 4000])
def test_the_trial_begins_when_the_arm_last_sets_off_before_it_touches(
    bench: Any, quiet: Any, block: int
) -> None:
    """A move to the start, a rest, the approach: the approach's first sample counts."""
    world = World(quiet())
    world.request("place_finger", {"finger": "index", "site": "a", "repeat": 1})
    z = world.specimen.surface_mm
    go = np.concatenate(
        [
            bench.line(world.arm().position_mm, z - 0.5, 20.0),
            bench.hold(z - 0.5, 0.3),
            bench.line(z - 0.5, z + 0.06, 1.0),
            bench.hold(z + 0.06, 0.3),
            bench.line(z + 0.06, z + 0.3, 5.0),
        ]
    )
    began = len(bench.line(world.arm().position_mm, z - 0.5, 20.0)) + 2400
    command = bench.volts(world, go)
    for at in range(0, len(command), block):
        world.advance(command[at : at + block])
    assert world.truth()["trial_start_s"] == began / 8000
