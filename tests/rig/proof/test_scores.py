"""Scores of a proof: each rule on reports made by hand."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.errors import BadInputError
from rig.proof import recovery, scores
from rig.proof.figures import by_name, figures
from rig.proof.scores import Outcome, is_right, read_truth

TISSUE = {"k0_mn_per_mm": 120.0, "k1_mn_per_mm": 44.0, "tau1_s": 2.3, "k2_mn_per_mm": 35.0, "tau2_s": 0.15}


def truth(*names: str, kind: str = "single") -> dict[str, Any]:
    hidden = [
        {
            "name": n,
            "in_library": True,
            "parameters": {"size_mn": 4.0},
            "phases": ["retract"],
            "strength": 20.0,
        }
        for n in names
    ]
    return {"number": 0, "kind": kind, "noise": "white", "skin": "living", "tissue": TISSUE, "hidden": hidden}


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
    (found,) = recovery.recoveries(opened(said("named", ("a",)), "a"))
    assert found.relative_error == pytest.approx(0.025)
    assert found.covered
    assert not recovery.recoveries(opened(said("named", ("b",)), "a"))


def test_tissue_bias_is_the_worst_constant() -> None:
    outcome = opened(said("named", ("a",), k0=120.6), "a")
    assert recovery.tissue_bias(outcome, "baseline") == pytest.approx(0.1)
    assert recovery.tissue_bias(outcome, "improved") == pytest.approx(0.005)


def test_what_counts_as_right() -> None:
    assert is_right(opened(said("no_mismatch"), kind="null"))
    assert not is_right(opened(said("named", ("a",)), kind="null"))
    assert not is_right(opened(said("unknown"), kind="null"))
    assert is_right(opened(said("unknown"), "odd", kind="outside"))
    assert not is_right(opened(said("unknown", ("a",)), "odd", kind="outside"))
    assert not is_right(opened(said("named", ("a",)), "odd", kind="outside"))
    assert is_right(opened(said("no_mismatch"), "c", kind="absorbed"))
    assert not is_right(opened(said("named", ("a",)), "c", kind="absorbed"))
    assert is_right(opened(said("one_of", ("b", "a")), "a"))
    assert not is_right(opened(said("unknown", ("a",)), "a"))
    assert not is_right(opened(said("named", ("a",), ("x",)), "a"))
    assert not is_right(opened(said("no_mismatch"), "a"))
    assert is_right(opened(said("named", ("a",), ("b",), ("c",)), "a", "b", "c", kind="triple"))
    assert not is_right(opened(said("named", ("a",), ("b",)), "a", "b", "c", kind="triple"))


NAMES = st.sampled_from("abcdxyz")
SETS = st.lists(st.lists(NAMES, min_size=1, max_size=3, unique=True).map(tuple), max_size=4)


@settings(deadline=None)
@given(st.sets(NAMES, min_size=1, max_size=3), SETS, st.sampled_from(["named", "one_of", "unknown"]))
def test_the_scores_agree_with_each_other(names: set[str], sets: list[tuple[str, ...]], verdict: str) -> None:
    """Whatever is said: all named implies all within; wrong and alone excludes a right first name; and so on."""
    outcome = opened(said(verdict, *sets), *names)
    if scores.all_named(outcome):
        assert scores.all_within(outcome)
        assert len(sets) >= len(names)
    if scores.wrong_and_alone(outcome):
        assert not scores.first_right(outcome)
        assert scores.wrong_library_name(outcome)
        assert not is_right(outcome)
    if is_right(outcome):
        assert scores.all_named(outcome)
        assert not scores.spurious(outcome)
    shuffled = opened(said(verdict, *reversed(sets)), *names)
    for score in (scores.all_named, scores.all_within, scores.spurious, is_right):
        assert score(shuffled) == score(outcome)  # the order decides nothing but the first name


@settings(deadline=None)
@given(SETS)
def test_naming_what_is_there_is_right_and_naming_more_is_not(more: list[tuple[str, ...]]) -> None:
    exactly = opened(said("named", ("p",), ("q", "r")), "p", "q")
    assert is_right(exactly)
    assert is_right(opened(said("named", ("p",), ("q", "r"), *more), "p", "q")) == (not more)


@settings(deadline=None)
@given(st.floats(0.5, 20.0), st.floats(0.01, 2.0))
def test_an_interval_is_1_96_standard_errors(value: float, se: float) -> None:
    report = said("named", ("a",))
    report["mechanisms"][0]["parameters"]["size_mn"] = {"value": value, "se": se, "unit": "mN"}
    (found,) = recovery.recoveries(opened(report, "a"))
    assert found.covered == (abs(value - 4.0) <= 1.96 * se)
    assert found.relative_error == pytest.approx(abs(value - 4.0) / 4.0)


def test_figures_count() -> None:
    outcomes = [
        opened(said("named", ("a",)), "a"),
        opened(said("named", ("b",)), "a"),
        opened(said("no_mismatch"), "a"),
        opened(said("named", ("a",)), kind="null"),
        opened(said("unknown", ("z",)), "odd", kind="outside"),
        opened(said("named", ("a",), ("b",), ("c",), ("x",)), "a", "b", "c", kind="triple"),
    ]
    (of_a,) = by_name(outcomes)
    assert (of_a.cases, of_a.detected, of_a.first, of_a.within, of_a.wrong_and_alone) == (3, 2, 1, 1, 1)
    found = {f.what: f.value for f in figures(outcomes)}
    assert found["false alarms on nulls"] == "1 of 1 (100.0%)"
    assert found["single: first name right"] == "1 of 3 (33.3%)"
    assert found["single: wrong and alone"] == "1 of 3 (33.3%)"
    assert found["triples: all named"] == "1 of 1 (100.0%)"
    assert found["triples: all named and nothing else"] == "0 of 1 (0.0%)"
    assert found["outside the library: unknown"] == "1 of 1 (100.0%)"
    assert found["outside the library: a wrong library name"] == "1 of 1 (100.0%)"


def test_something_else_than_a_sealed_case_is_refused_in_one_line() -> None:
    with pytest.raises(BadInputError, match="not a concealed case") as error:
        read_truth({"number": 1})
    assert "\n" not in str(error.value)
