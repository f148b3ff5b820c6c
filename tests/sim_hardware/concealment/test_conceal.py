"""Concealed cases: how strong an effect is, and that what is drawn is what is sealed."""

from __future__ import annotations

import numpy as np
import pytest

from sim_hardware.concealment.cases import NOISES, SKINS, draw_case, draw_cases, draw_together, outsiders
from sim_hardware.concealment.conceal import Keeper
from sim_hardware.concealment.drawn import drawn_study
from sim_hardware.concealment.knobs import ABSORBED, KNOBS, LIBRARY, OUTSIDE, SAME_AS_A_LAW, TAKEN_UP
from sim_hardware.concealment.plans import study_plans
from sim_hardware.concealment.sealing import digest, seal
from sim_hardware.concealment.sizes import BENCH_SIZES, OTHER_SIZES, OUTSIDE_SIZES, SIZES
from sim_hardware.concealment.strength import explained, peak_mn, strength, tissue_of
from sim_hardware.effects import EFFECTS, make_effect
from sim_hardware.settings import BenchSettings, EffectSettings

SHORT = study_plans(depths_mm=(0.4, 0.6), repeats=1, hold_s=1.0, dwell_s=0.4)
SHARED = BenchSettings.from_toml("seed = 8\n[specimens]\nsite_variation = 0.0")
LIVING = BenchSettings.from_toml("seed = 8")


def of(name: str, bench: BenchSettings = SHARED, **parameters: float) -> float:
    return strength(bench, [EffectSettings.model_validate({"name": name, **parameters})], SHORT)


def test_nothing_has_no_strength() -> None:
    assert strength(SHARED, [], SHORT) == pytest.approx(0.0, abs=1e-6)


def test_strength_of_a_linear_effect_is_proportional_and_adds_up_over_trials() -> None:
    one = of("viscous_friction", coefficient_mn_s_per_mm=0.1)
    assert of("viscous_friction", coefficient_mn_s_per_mm=0.3) == pytest.approx(3 * one, rel=1e-6)
    more = study_plans(depths_mm=(0.4, 0.6), repeats=4, hold_s=1.0, dwell_s=0.4)
    effect = EffectSettings.model_validate({"name": "viscous_friction", "coefficient_mn_s_per_mm": 0.1})
    assert strength(SHARED, [effect], more) == pytest.approx(2 * one, rel=1e-5)  # each at a height of its own


def test_what_the_tissue_can_imitate_has_hardly_any_strength() -> None:
    """A spring in series with a solid of two arms is again a solid of two arms."""
    compliant = of("lever_compliance", compliance_um_per_mn=0.05, rough=0.0)
    friction = of("coulomb_friction", force_mn=1.0)
    assert compliant < 0.01 * friction


def test_a_servo_is_seen_in_the_position() -> None:
    assert of("servo_bandwidth", natural_frequency_rad_s=3.0e3) > 50


def test_known_strength_of_friction_in_air() -> None:
    """1 mN against the motion: about the root of the number of moving samples, over the noise."""
    moving_samples = 2 * 8000 * (0.5 / 1.0 + 1.0 / 5.0)
    assert (
        0.2 * np.sqrt(moving_samples) / 0.3
        < of("coulomb_friction", force_mn=1.0, rough=0.0)
        < 2 * np.sqrt(moving_samples) / 0.3
    )


def test_living_skin_takes_up_what_repeating_tissue_can_not() -> None:
    """A finger that softens from trial to trial is another tissue in each; friction is none in any."""
    softer = {
        name: of("warming_tissue", bench, softening=0.02)
        for name, bench in (("shared", SHARED), ("living", LIVING))
    }
    assert softer["living"] < 0.1 * softer["shared"]
    rubbing = [of("coulomb_friction", bench, force_mn=1.0) for bench in (SHARED, LIVING)]
    assert rubbing[1] == pytest.approx(rubbing[0], rel=0.1)


@pytest.mark.parametrize("name", KNOBS)
def test_every_size_stays_within_its_effect(name: str) -> None:
    knob = KNOBS[name]
    random = np.random.default_rng(1)
    for _ in range(20):
        drawn = knob.draw(random)
        for size in SIZES[name]:
            make_effect(name, knob.values(150.0 - size if knob.below_peak else size, drawn))
    assert EFFECTS[name].in_library == (name not in OUTSIDE)


def test_every_effect_has_a_knob_and_a_size() -> None:
    assert set(KNOBS) == set(EFFECTS) == set(SIZES)
    assert set(BENCH_SIZES) | set(OTHER_SIZES) == set(LIBRARY) | set(ABSORBED)
    assert set(OUTSIDE_SIZES) == set(OUTSIDE)
    assert set(SAME_AS_A_LAW) < set(OUTSIDE)
    assert set(OUTSIDE) - set(outsiders("living")) == {*SAME_AS_A_LAW, *TAKEN_UP}
    assert set(OUTSIDE) - set(outsiders("shared")) == set(SAME_AS_A_LAW)


@pytest.mark.parametrize(
    ("name", "law", "alike"),
    [
        ("cable_drag", "force_drift", True),
        ("skin_hair", "position_crosstalk", True),
        ("range_jump", "force_drift", False),
    ],
)
def test_what_is_as_good_as_a_law_is_measured(name: str, law: str, alike: bool) -> None:
    """Over eight trials 0.93, 0.87 and 0.03."""
    pair = [
        EffectSettings.model_validate({"name": n, "rough": rough}) for n, rough in ((name, 0.8), (law, 0.0))
    ]
    assert (explained(LIVING, pair[0], pair[1], study_plans(depths_mm=(0.4, 0.8), repeats=1)) > 0.75) == alike
    assert not alike or SAME_AS_A_LAW[name] == law


def test_a_case_is_of_a_size_that_benches_have() -> None:
    case = draw_case(0, "triple", ["adhesion", "force_saturation", "heartbeat"], seed=4, plans=SHORT)
    peel, bent, pulse = case.hidden
    assert 2.0 <= peel.parameters["pull_off_mn"] <= 5.0
    assert 2.0 <= pulse.parameters["amplitude_um"] <= 5.0
    peak = peak_mn(case.settings.model_copy(update={"effects": ()}), SHORT)
    assert 5.0 <= peak - bent.parameters["level_mn"] <= 15.0
    assert [e.given for e in case.settings.effects] == [dict(h.parameters) for h in case.hidden]
    assert all(h.strength > 10 for h in case.hidden)


@pytest.mark.parametrize("skin", SKINS)
def test_tissue_that_is_told_is_the_mean_of_what_was_pressed(skin: str) -> None:
    case = draw_case(0, "null", (), "white", skin, seed=4, plans=SHORT)  # type: ignore[arg-type]
    k0, _, tau1, _, tau2 = case.tissue.values()
    assert tuple(case.tissue.values()) == tissue_of(case.settings, SHORT)
    if skin == "shared":
        assert (tau1, tau2) == pytest.approx((2.279, 0.149))
        assert k0 == pytest.approx(120.0, rel=0.1)
    else:
        assert abs(tau1 / 2.279 - 1) > 1e-3


def test_a_laboratory_that_is_drawn_is_another_one_for_every_seed_and_within_its_ranges() -> None:
    studies = [drawn_study(seed) for seed in range(40)]
    assert studies[3] == drawn_study(3)
    assert len({(s[0].hold_s, s[0].ramp_speed_mm_s, s[0].retract_speed_mm_s) for s in studies}) > 20
    assert all(2 <= len({plan.depth_mm for plan in s}) <= 4 for s in studies)
    assert all(5 <= len(s) <= 40 for s in studies)
    assert all(0.2 <= plan.depth_mm <= 0.8 for s in studies for plan in s)
    skins = [
        draw_case(0, "null", (), "white", "drawn", seed=seed, plans=SHORT[:1]).settings for seed in (1, 2)
    ]
    assert skins[0].tissue != skins[1].tissue
    assert skins[0].specimens != skins[1].specimens


def test_every_noise_and_skin_makes_a_bench_of_its_own() -> None:
    benches = {
        draw_case(0, "null", (), noise, skin, seed=4, plans=SHORT[:1]).settings.model_dump_json()
        for noise in NOISES
        for skin in SKINS
    }
    assert len(benches) == len(NOISES) * len(SKINS)


def test_the_same_seed_draws_the_same_nulls_and_another_does_not() -> None:
    first, again, other = (draw_cases(3, seed, SHORT[:1], kinds=("null",)) for seed in (5, 5, 6))
    assert [c.truth() for c in first] == [c.truth() for c in again]
    assert [c.truth() for c in first] != [c.truth() for c in other]
    assert {c.noise for c in draw_cases(60, 2, SHORT[:1], kinds=("null",))} == set(NOISES)


def test_what_is_hidden_together_can_be_told_apart() -> None:
    random = np.random.default_rng(0)
    for n in (2, 3):
        for _ in range(300):
            chosen = set(draw_together(random, n))
            assert len(chosen) == n
            assert len(chosen & {"parallel_dashpot", "force_lag", "coulomb_friction"}) < 2


def test_a_seal_commits_to_salt_and_truth() -> None:
    truth = {"b": 1.5, "a": ["x"]}
    first, second = seal(truth), seal(truth)
    assert first.text == second.text == '{"a":["x"],"b":1.5}'
    assert first.seal != second.seal
    assert digest(first.salt, first.text) == first.seal
    assert digest(first.salt, first.text.replace("1.5", "1.6")) != first.seal


def test_the_keeper_hands_out_once() -> None:
    keeper = Keeper(["a", "b"])
    assert keeper.hand_out(1) == "b"
    with pytest.raises(ValueError, match="already"):
        keeper.hand_out(1)
    with pytest.raises(ValueError, match="there are 2"):
        keeper.hand_out(-1)
    keeper.close()
    with pytest.raises(ValueError, match="already"):
        keeper.hand_out(0)
