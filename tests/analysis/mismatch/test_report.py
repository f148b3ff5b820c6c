from __future__ import annotations

import math
import re
from typing import Any

import pytest

NUMBER = (int, float)
QUANTITY = {"value": NUMBER, "se": NUMBER, "unit": str}
WINDOW = {
    "signal": str,
    "phase": str,
    "start_s": NUMBER,
    "stop_s": NUMBER,
    "mean_residual_mn": (int, float, type(None)),
    "p_value": NUMBER,
    "share_of_mismatch": NUMBER,
    "conditions": str,
}
HELDOUT = {
    "scheme": str,
    "n_trials": int,
    "noise_floor_mn": NUMBER,
    "baseline_rms_mn": NUMBER,
    "improved_rms_mn": NUMBER,
    "baseline_chi2": NUMBER,
    "improved_chi2": NUMBER,
    "p_value": NUMBER,
}
KEYS = {
    "format": str,
    "format_version": int,
    "verdict": str,
    "summary": str,
    "n_trials": int,
    "sample_rate_hz": NUMBER,
    "baseline": str,
    "false_alarm_rate": NUMBER,
    "mismatch": list,
    "mechanisms": list,
    "not_identifiable": list,
    "baseline_parameters": dict,
    "improved_parameters": dict,
    "heldout": dict,
    "explained_share": NUMBER,
    "next_experiment": (dict, type(None)),
    "remainder": (dict, type(None)),
}
TISSUE = ("k0_mn_per_mm", "k1_mn_per_mm", "tau1_s", "k2_mn_per_mm", "tau2_s")
PHASES = ("approach", "dwell", "ramp", "hold", "retract", "clear", "sweep")


def check(found: Any, wanted: dict[str, Any], where: str) -> None:
    for key, kind in wanted.items():
        assert key in found, f"{where} lacks {key}"
        assert isinstance(found[key], kind), f"{where}.{key} = {found[key]!r}"
        if isinstance(found[key], float):
            assert math.isfinite(found[key]), f"{where}.{key}"


def check_report(report: dict[str, Any]) -> None:
    check(report, KEYS, "report")
    assert report["format"] == "indenter-diagnosis"
    assert report["format_version"] == 1
    assert report["verdict"] in ("no_mismatch", "named", "one_of", "unknown")
    windows = report["mismatch"] + (report["remainder"] or {"where": []})["where"]
    for window in windows:
        check(window, WINDOW, "mismatch")
        assert window["signal"] in ("force", "position")
        assert window["phase"] in PHASES
        assert window["start_s"] < window["stop_s"]
        assert 0 <= window["share_of_mismatch"] <= 1
        assert (window["mean_residual_mn"] is None) == (window["signal"] == "position")
    for m in report["mechanisms"]:
        check(
            m,
            {
                "name": str,
                "stage": str,
                "alternatives": list,
                "p_value": NUMBER,
                "explanation": str,
                "probability": NUMBER,
                "alternative_probabilities": dict,
            },
            "mechanism",
        )
        for quantity in m["parameters"].values():
            check(quantity, QUANTITY, m["name"])
    for hidden in report["not_identifiable"]:
        check(hidden, {"name": str, "reason": str, "separated_by": str}, "not_identifiable")
    for name in ("baseline_parameters", "improved_parameters"):
        assert set(TISSUE) <= set(report[name])
        for quantity in report[name].values():
            check(quantity, QUANTITY, name)
        assert report[name]["tau1_s"]["value"] > report[name]["tau2_s"]["value"]
    check(report["heldout"], HELDOUT, "heldout")
    assert 0 <= report["explained_share"] <= 1
    if report["next_experiment"] is not None:
        check(
            report["next_experiment"], {"protocol": str, "separates": list, "reason": str}, "next_experiment"
        )
    if report["remainder"] is not None:
        check(report["remainder"], {"share": NUMBER, "rms_mn": NUMBER, "where": list}, "remainder")


@pytest.mark.parametrize("study", ["clinging", "plain", "alone"])
def test_report_holds_every_key_with_finite_numbers(study: str, request: pytest.FixtureRequest) -> None:
    check_report(request.getfixturevalue(study).report)


def test_adhesion_is_named_where_contact_is_lost(clinging: Any) -> None:
    report = clinging.report
    assert report["verdict"] == "named"
    assert [m["name"] for m in report["mechanisms"]] == ["adhesion"]
    pull_off = report["mechanisms"][0]["parameters"]["pull_off_mn"]
    assert pull_off["value"] == pytest.approx(5.0, rel=0.3)
    largest = report["mismatch"][0]
    assert (largest["signal"], largest["phase"]) == ("force", "retract")
    assert largest["mean_residual_mn"] < 0
    assert report["explained_share"] > 0.8
    assert report["heldout"]["improved_rms_mn"] < report["heldout"]["baseline_rms_mn"]
    assert report["heldout"]["improved_chi2"] == pytest.approx(1.0, abs=0.05)
    assert "adhesion" in report["summary"]


def test_a_bench_that_does_what_the_simulation_says_has_no_mismatch(plain: Any) -> None:
    report = plain.report
    assert report["verdict"] == "no_mismatch"
    assert report["mismatch"] == []
    assert report["mechanisms"] == []
    assert report["improved_parameters"] == report["baseline_parameters"]
    heldout = report["heldout"]
    for what in ("rms_mn", "chi2"):
        assert heldout[f"improved_{what}"] == heldout[f"baseline_{what}"]
    assert heldout["noise_floor_mn"] == pytest.approx(0.3, rel=0.05)
    assert report["baseline_parameters"]["k0_mn_per_mm"]["value"] == pytest.approx(120.0, rel=0.02)
    assert "lever_compliance" in [h["name"] for h in report["not_identifiable"]]


def test_a_single_trial_is_diagnosed_and_told_what_that_weakens(alone: Any) -> None:
    assert alone.report["n_trials"] == 1
    assert "Only 1 trial was given" in alone.report["summary"]
    assert "nothing could be held out" in alone.report["summary"]


@pytest.mark.parametrize("study", ["clinging", "plain"])
def test_page_needs_nothing_but_itself(study: str, request: pytest.FixtureRequest) -> None:
    found = request.getfixturevalue(study)
    html = (found.out / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"(?:src|href)=\"(?!data:)", html)
    assert "http" not in html.replace("http-equiv", "")
    assert html.count("data:image/png;base64,") >= 2
    for name in ("trial.png", "residual.png", "twin.toml"):
        assert (found.out / name).stat().st_size > 0
    for heading in ("How sure", "What to do next", "tissue"):
        assert heading in html


def test_page_names_mechanism_and_parameters(clinging: Any) -> None:
    html = (clinging.out / "report.html").read_text(encoding="utf-8")
    assert "the skin clings to the punch" in html
    assert "pull off" in html
    assert "bias before" in html
