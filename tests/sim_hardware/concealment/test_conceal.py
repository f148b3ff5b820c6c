"""Concealed cases: how strong an effect is, and that what is drawn is what is sealed."""

from __future__ import annotations

import numpy as np
import pytest

from sim_hardware.concealment.cases import (
    LIBRARY,
    NOISES,
    OUTSIDE,
    draw_case,
    draw_cases,
    draw_pair,
    true_tissue,
)
from sim_hardware.concealment.conceal import Keeper
from sim_hardware.concealment.knobs import ABSORBED
from sim_hardware.concealment.plans import study_plans
from sim_hardware.concealment.sealing import digest, seal
from sim_hardware.concealment.strength import strength
from sim_hardware.effects import EFFECTS, make_effect
from sim_hardware.settings import BenchSettings, EffectSettings

SHORT = study_plans(depths_mm=(0.4, 0.6), repeats=1, hold_s=1.0, dwell_s=0.4)
BENCH = BenchSettings(seed=8)


def of(name: str, **parameters: float) -> float:
    return strength(BENCH, [EffectSettings.model_validate({"name": name, **parameters})], SHORT)


def test_nothing_has_no_strength() -> None:
    assert strength(BENCH, [], SHORT) == pytest.approx(0.0, abs=1e-6)


def test_strength_of_a_linear_effect_is_proportional_and_adds_up_over_trials() -> None:
    one = of("viscous_friction", coefficient_mn_s_per_mm=0.1)
    assert of("viscous_friction", coefficient_mn_s_per_mm=0.3) == pytest.approx(3 * one, rel=1e-6)
    more = study_plans(depths_mm=(0.4, 0.6), repeats=4, hold_s=1.0, dwell_s=0.4)
    effect = EffectSettings.model_validate({"name": "viscous_friction", "coefficient_mn_s_per_mm": 0.1})
    assert strength(BENCH, [effect], more) == pytest.approx(2 * one, rel=1e-5)  # each at a height of its own


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


@pytest.mark.parametrize(("name", "rung"), [("adhesion", 100.0), ("lever_arc", 20.0), ("dropped_bit", 300.0)])
def test_a_case_is_as_strong_as_asked_for(name: str, rung: float) -> None:
    kind = "single" if name in LIBRARY else "outside"
    case = draw_case(0, kind, [name], rung, seed=4)
    (hidden,) = case.hidden
    assert hidden.strength == pytest.approx(rung, rel=0.06)
    assert case.settings.effects[0].given == dict(hidden.parameters)


@pytest.mark.parametrize("name", [*LIBRARY, *OUTSIDE, *ABSORBED])
def test_every_knob_stays_within_its_effect(name: str) -> None:
    knob = {**LIBRARY, **OUTSIDE, **ABSORBED}[name]
    random = np.random.default_rng(1)
    for _ in range(20):
        drawn = knob.draw(random)
        for size in (max(knob.low, 1e-6), knob.start, knob.high):
            make_effect(name, knob.values(size, drawn))
    assert EFFECTS[name].in_library == (name not in OUTSIDE)


def test_every_effect_has_a_knob() -> None:
    assert {*LIBRARY, *OUTSIDE, *ABSORBED} == set(EFFECTS)


def test_the_same_seed_draws_the_same_nulls_and_another_does_not() -> None:
    first, again, other = (draw_cases(3, seed, kinds=("null",)) for seed in (5, 5, 6))
    assert [c.truth() for c in first] == [c.truth() for c in again]
    assert [c.truth() for c in first] != [c.truth() for c in other]
    assert {c.noise for c in draw_cases(40, 2, kinds=("null",))} == set(NOISES)


def test_pairs_can_be_told_apart() -> None:
    random = np.random.default_rng(0)
    for _ in range(500):
        pair = draw_pair(random)
        assert len(set(pair)) == 2
        assert set(pair) != {"third_relaxation", "poroelastic_drainage"}


def test_true_tissue_names_the_longer_time_first() -> None:
    tissue = true_tissue(BenchSettings.from_toml("[specimens]\npublished_tissue = true"))
    assert tissue["k0_mn_per_mm"] == 120.0
    assert tissue["tau1_s"] == 2.279
    assert tissue["tau2_s"] == 0.149


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
