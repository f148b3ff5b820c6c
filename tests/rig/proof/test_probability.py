"""Calibration of probabilities: on statements made by hand, and on ones that are drawn to be calibrated."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rig.proof.probability import NONE, Statement, expected_calibration_error, set_size, statements
from rig.proof.scores import Effect, Outcome, Truth


def outcome(names: tuple[str, ...], *mechanisms: dict[str, object]) -> Outcome:
    effects = tuple(Effect(n, True, {}, (), 1.0) for n in names)
    return Outcome(Truth(0, "single", "white", "living", effects, {}), {"mechanisms": list(mechanisms)})


def test_a_statement_is_the_name_its_alternatives_and_none() -> None:
    (said,) = statements(
        outcome(("b",), {"name": "a", "probability": 0.6, "alternative_probabilities": {"b": 0.35}})
    )
    assert dict(said.probabilities) == pytest.approx({"a": 0.6, "b": 0.35, NONE: 0.05})
    assert said.truth == "b"
    assert said.credible == ("a", "b")
    assert said.held
    assert set_size([said]) == 2.0


def test_what_is_not_there_is_none_of_these() -> None:
    (said,) = statements(outcome(("z",), {"name": "a", "probability": 0.95}))
    assert said.truth == NONE
    assert not said.held
    (unsure,) = statements(outcome((), {"name": "a", "probability": 0.55}))
    assert unsure.credible == ("a", NONE)
    assert unsure.held
    assert set_size([unsure]) == 1.0


def test_a_report_without_probabilities_says_nothing() -> None:
    assert statements(outcome(("a",), {"name": "a"})) == []
    assert math.isnan(expected_calibration_error([]))


def test_error_of_calibration_by_hand() -> None:
    """0.8 said ten times and right seven: 0.1 off; 0.3 said ten times and right three: not off."""
    said = [Statement((("a", 0.8), (NONE, 0.2)), "a" if i < 7 else NONE) for i in range(10)]
    said += [Statement((("a", 0.3), (NONE, 0.7)), "a" if i < 3 else NONE) for i in range(10)]
    assert expected_calibration_error(said) == pytest.approx(0.05)


@pytest.mark.parametrize("seed", range(4))
def test_calibrated_statements_have_hardly_any_error_and_overconfident_ones_have(seed: int) -> None:
    """Over 200 seeds the error of 2000 calibrated statements was 0.023 +- 0.006: 0.06 is six deviations above."""
    random = np.random.default_rng(seed)
    p = random.uniform(0, 1, 2000)
    right = random.random(2000) < p
    fair = [
        Statement((("a", float(q)), (NONE, float(1 - q))), "a" if r else NONE)
        for q, r in zip(p, right, strict=True)
    ]
    bold = [
        Statement((("a", float(q**0.3)), (NONE, float(1 - q**0.3))), s.truth)
        for q, s in zip(p, fair, strict=True)
    ]
    assert expected_calibration_error(fair) < 0.06
    assert expected_calibration_error(bold) > 0.15


@settings(deadline=None)
@given(st.lists(st.floats(0.01, 1.0), min_size=1, max_size=6))
def test_the_set_is_the_smallest_that_is_probable_enough(weights: list[float]) -> None:
    total = sum(weights) * 1.05
    probabilities = {f"n{i}": w / total for i, w in enumerate(weights)}
    probabilities[NONE] = 1 - sum(probabilities.values())
    said = Statement(tuple(probabilities.items()), NONE)
    sizes = sorted(probabilities.values(), reverse=True)
    k = len(said.credible)
    assert sum(probabilities[n] for n in said.credible) >= 0.9 - 1e-6
    assert sum(sizes[: k - 1]) < 0.9 + 1e-6
