"""Scores of a proof: each rule on reports made by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from analysis.errors import BadInputError
from rig.proof import scores
from rig.proof.figures import figures, ladder
from rig.proof.page import is_right
from rig.proof.scores import Outcome, read_truth

TISSUE = {"k0_mn_per_mm": 120.0, "k1_mn_per_mm": 44.0, "tau1_s": 2.3, "k2_mn_per_mm": 35.0, "tau2_s": 0.15}


def truth(*names: str, kind: str = "single", rung: float = 20.0) -> dict[str, Any]:
    hidden = [
        {
            "name": n,
            "in_library": True,
            "parameters": {"size_mn": 4.0},
            "phases": ["retract"],
            "strength": rung,
        }
        for n in names
    ]
    return {"number": 0, "kind": kind, "rung": rung, "noise": "white", "tissue": TISSUE, "hidden": hidden}


def said(
    verdict: str, *sets: tuple[str, ...], phases: tuple[tuple[str, float], ...] = (), k0: float = 120.0
) -> dict[str, Any]:
    quantity = {"value": 4.1, "se": 0.1, "unit": "mN"}
    tissue = {name: {"value": value, "se": 0.1, "unit": ""} for name, value in TISSUE.items()}
    return {
        "verdict": verdict,
        "mechanisms": [
            {"name": s[0], "alternatives": list(s[1:]), "parameters": {"size_mn": quantity}} for s in sets
        ],
        "mismatch": [{"phase": p, "share_of_mismatch": share} for p, share in phases],
        "not_identifiable": [{"name": "c"}],
        "baseline_parameters": {**tissue, "k0_mn_per_mm": {"value": 132.0, "se": 1.0, "unit": ""}},
        "improved_parameters": {**tissue, "k0_mn_per_mm": {"value": k0, "se": 1.0, "unit": ""}},
        "heldout": {"baseline_chi2": 9.0, "improved_chi2": 1.01},
    }


def opened(report: dict[str, Any], *names: str, **more: Any) -> Outcome:
    return Outcome(read_truth(truth(*names, **more)), report)


def test_first_name_and_named_set() -> None:
    outcome = opened(said("one_of", ("b", "a")), "a")
    assert not scores.first_right(outcome)
    assert scores.all_within(outcome)
    assert not scores.wrong_and_alone(outcome)
    assert scores.first_right(opened(said("named", ("a",)), "a"))


def test_wrong_and_alone_is_a_wrong_name_without_alternatives() -> None:
    assert scores.wrong_and_alone(opened(said("named", ("b",)), "a"))
    assert not scores.wrong_and_alone(opened(said("unknown", ("b",)), "a"))
    assert not scores.wrong_and_alone(opened(said("unknown"), "a"))


def test_a_pair_needs_a_mechanism_for_each() -> None:
    both = opened(said("named", ("b", "a"), ("a",)), "a", "b", kind="pair")
    assert scores.all_named(both)
    one = opened(said("one_of", ("a", "b")), "a", "b", kind="pair")
    assert scores.all_within(one)
    assert not scores.all_named(one)


def test_spurious_mechanisms_are_counted() -> None:
    assert scores.spurious(opened(said("named", ("a",), ("x",), ("y", "z")), "a")) == 2


def test_place_is_judged_by_the_largest_share() -> None:
    outcome = opened(said("unknown", phases=(("hold", 0.3), ("retract", 0.7))), "a", kind="outside")
    assert scores.right_phase(outcome)
    assert scores.location_overlap(outcome) == pytest.approx(0.7)
    elsewhere = opened(said("unknown", phases=(("hold", 0.9), ("retract", 0.1))), "a", kind="outside")
    assert not scores.right_phase(elsewhere)
    assert scores.location_overlap(opened(said("unknown"), "a")) is None


def test_recovery_and_coverage() -> None:
    (found,) = scores.recoveries(opened(said("named", ("a",)), "a"))
    assert found.relative_error == pytest.approx(0.025)
    assert found.covered
    assert not scores.recoveries(opened(said("named", ("b",)), "a"))


def test_tissue_bias_is_the_worst_constant() -> None:
    outcome = opened(said("named", ("a",), k0=120.6), "a")
    assert scores.tissue_bias(outcome, "baseline") == pytest.approx(0.1)
    assert scores.tissue_bias(outcome, "improved") == pytest.approx(0.005)


@given(st.floats(0.05, 0.95), st.floats(0.001, 0.2))
def test_matched_test_is_inverted(power: float, level: float) -> None:
    assert scores.matched_power(scores.matched_strength(power, level), level) == pytest.approx(power)


def test_strength_of_half_and_most_detections_is_found_again() -> None:
    """2000 detections drawn from a probit at ln 6 of width 0.3 tell both points to 1 %, one sigma."""
    random = np.random.default_rng(3)
    strengths = np.exp(random.uniform(np.log(2), np.log(20), 2000))
    detected = random.random(2000) < norm.cdf(np.log(strengths / 6) / 0.3)
    half = scores.strength_at(0.5, strengths.tolist(), detected.tolist())
    most = scores.strength_at(0.9, strengths.tolist(), detected.tolist())
    assert half == pytest.approx(6, rel=0.05)
    assert most == pytest.approx(6 * np.exp(0.3 * norm.ppf(0.9)), rel=0.08)
    assert scores.strength_at(0.5, [3.0, 5.0], [True, True]) is None


def test_decibel() -> None:
    assert scores.decibel(10.0) == pytest.approx(20.0)


def test_what_counts_as_right() -> None:
    assert is_right(opened(said("no_mismatch"), kind="null", rung=0.0))
    assert not is_right(opened(said("named", ("a",)), kind="null", rung=0.0))
    assert is_right(opened(said("unknown"), "odd", kind="outside"))
    assert not is_right(opened(said("named", ("a",)), "odd", kind="outside"))
    assert is_right(opened(said("no_mismatch"), "c", kind="absorbed", rung=0.0))
    assert not is_right(opened(said("named", ("a",)), "c", kind="absorbed", rung=0.0))
    assert not is_right(opened(said("named", ("a",), ("x",)), "a"))


def test_figures_and_ladder_count() -> None:
    outcomes = [
        opened(said("named", ("a",)), "a", rung=20.0),
        opened(said("named", ("b",)), "a", rung=20.0),
        opened(said("no_mismatch"), "a", rung=3.0),
        opened(said("named", ("a",)), kind="null", rung=0.0),
    ]
    weak, strong = ladder(outcomes)
    assert (weak.cases, weak.detected) == (1, 0)
    assert (strong.cases, strong.detected, strong.first, strong.within, strong.wrong_and_alone) == (
        2,
        2,
        1,
        1,
        1,
    )
    found = {f.what: f.value for f in figures(outcomes)}
    assert found["false alarms on nulls"] == "1 of 1 (100.0%)"
    assert found["single, strength 20 and more: first name right"] == "1 of 2 (50.0%)"
    assert found["single, any strength: wrong and alone"] == "1 of 3 (33.3%)"


def test_something_else_than_a_sealed_case_is_refused_in_one_line() -> None:
    with pytest.raises(BadInputError, match="not a concealed case") as error:
        read_truth({"number": 1})
    assert "\n" not in str(error.value)
