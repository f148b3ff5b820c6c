"""What campaigns draw, keep and count, with the diagnosis replaced by what it might say."""

from __future__ import annotations

import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import campaign
import concealed
import rivals

from rig.proof.scores import Outcome, is_right
from sim_hardware.concealment.sizes import BENCH_SIZES


def told(kind: str, *names: str, stage: str = "contact") -> dict[str, Any]:
    effects = [
        {
            "name": n,
            "stage": stage,
            "parameters": {"drop_mn": {"value": 2.5, "unit": "mN"}, "time_s": {"value": None, "unit": "s"}},
        }
        for n in names
    ]
    return {
        "kind": kind,
        "expected": {"null": ["no_mismatch"], "outside": ["unknown"]}.get(kind, ["named", "one_of"]),
        "effects": effects,
        "scatter": {"tissue_constants": 0.1},
        "noise": {"white_mn": 0.2},
        "mean_tissue": {"k0_mn_per_mm": 114.0},
    }


def said(verdict: str, *names: str) -> dict[str, Any]:
    drop = {"drop_mn": {"value": 2.6, "se": 0.1, "unit": "mN"}}
    mechanisms = [{"name": n, "alternatives": [], "parameters": drop} for n in names]
    tissue = {"k0_mn_per_mm": {"value": 120.0}}
    return {
        "verdict": verdict,
        "mechanisms": mechanisms,
        "mismatch": [],
        "baseline_parameters": tissue,
        "improved_parameters": tissue,
        "heldout": {"baseline_chi2": 1.5, "improved_chi2": 1.0},
    }


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    truths = {
        "a": told("null"),
        "b": told("single", "slip"),
        "c": told("outside", "punch_tilt", stage="outside"),
        "d": told("pair", "slip", "adhesion"),
        "e": told("single", "slip"),
    }
    (tmp_path / "truth.json").write_text(json.dumps(truths))
    return tmp_path


SAID = {
    "a": said("no_mismatch"),
    "b": said("named", "slip"),
    "c": said("unknown"),
    "d": said("named", "slip"),
    "e": said("unknown", "slip"),
}
COST = {"wall_s": 3.0, "cpu_s": 2.0, "peak_mb": 100.0}


def test_folders_by_another_hand_are_counted(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[str] = []

    def diagnose(trials: Path, out: Path, seed: int) -> dict[str, Any]:
        asked.append(trials.name)
        if trials.name == "e" and asked.count("e") == 1:
            raise KeyboardInterrupt
        return {**COST, "error": "", "report": SAID[trials.name]}

    monkeypatch.setattr(concealed, "diagnose", diagnose)
    out = tmp_path / "kept"
    with pytest.raises(KeyboardInterrupt):
        concealed.run(folder, out)
    rows = concealed.run(folder, out)  # goes on where it was stopped
    assert Counter(asked) == {"a": 1, "b": 1, "c": 1, "d": 1, "e": 2}
    assert concealed.score(rows) == 3
    shown = capsys.readouterr().out
    assert "3 of 5 right" in shown
    assert "drop_mn 2.6±0.1 for 2.5" in shown
    assert len(concealed.run(folder, out, only=("b",))) == 1


@pytest.mark.parametrize("phase", ["hold", "ramp"])
def test_where_it_shows_and_what_is_there_besides_are_counted(
    phase: str, capsys: pytest.CaptureFixture[str]
) -> None:
    beside = {"allowed_extra": ["mains_hum"]}
    outside = {**told("outside", "film", stage="outside"), **beside, "phase": ["hold", "retract"]}
    found = {**said("unknown", "mains_hum"), "mismatch": [{"phase": phase, "share_of_mismatch": 0.9}]}
    rows = [
        {**COST, "error": "", "name": "a", "truth": outside, "report": found},
        {
            **COST,
            "error": "",
            "name": "b",
            "truth": told("null") | beside,
            "report": said("named", "mains_hum"),
        },
        {**COST, "error": "", "name": "c", "truth": told("null"), "report": said("named", "mains_hum")},
    ]
    assert concealed.score(rows) == 2
    shown = next(r for r in capsys.readouterr().out.splitlines() if "outside the library: right phase" in r)
    assert f"{int(phase == 'hold')} of 1" in shown


def test_a_case_that_fails_is_wrong(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(concealed, "diagnose", lambda *given: {**COST, "error": "out of memory"})
    assert concealed.score(concealed.run(folder, tmp_path / "kept")) == 0


def test_what_another_hand_calls_right_is_what_the_proof_calls_right(folder: Path) -> None:
    truths = concealed.read_truths(folder)
    right = {name: is_right(Outcome(concealed.as_truth(0, truths[name]), SAID[name])) for name in truths}
    assert right == {"a": True, "b": True, "c": True, "d": False, "e": False}
    slip = concealed.as_truth(0, truths["b"]).effects[0]
    assert slip.parameters == {"drop_mn": 2.5}  # a time that differs from trial to trial is none
    odd = json.loads((folder / "truth.json").read_text())
    odd["a"]["expected"] = ["unknown"]
    (folder / "truth.json").write_text(json.dumps(odd))
    with pytest.raises(AssertionError):
        concealed.read_truths(folder)


def test_every_name_and_every_noise_has_its_turn() -> None:
    singles = campaign.specs("singles", len(BENCH_SIZES) * len(campaign.NOISES), 1)
    assert Counter(names for _, names, _ in singles) == {
        (name,): len(campaign.NOISES) for name in BENCH_SIZES
    }
    assert len(set(singles)) == len(singles)
    assert {kind for kind, _, _ in singles} == {"single"}
    outside = campaign.specs("outside", 40, 1)
    assert {kind for kind, _, _ in outside} == {"outside"}
    assert ("glue_creep",) not in {names for _, names, _ in outside}  # a solid of three arms, as a law has it
    assert all(len(set(names)) == 3 for _, names, _ in campaign.specs("triples", 30, 1))
    assert campaign.specs("triples", 30, 1) == campaign.specs("triples", 40, 1)[:30]
    for name in campaign.CAMPAIGNS:
        assert len(campaign.specs(name, 7, 1)) == 7


def test_seeds_are_blind_and_kept(tmp_path: Path) -> None:
    seeds = {campaign.campaign_seed("nulls-living", tmp_path / str(i), None) for i in range(4)}
    assert len(seeds) == 4
    again = campaign.campaign_seed("nulls-living", tmp_path / "0", None)
    assert again in seeds
    assert campaign.campaign_seed("nulls-living", tmp_path / "0", 7) == again
    assert campaign.campaign_seed("nulls-shared", tmp_path / "0", 7) == 7


def test_every_trial_of_a_campaign_has_a_site_of_its_own() -> None:
    plans = campaign.plans(5)
    assert len({(p.finger, p.site) for p in plans}) == len(plans) == 20
    assert all(120 <= p.rest_s <= 180 for p in plans)


def test_rivals_see_friction_on_living_skin(bench_trials: Any) -> None:
    """Two trials with 3 mN of friction: each rival finds something, and AIC and BIC name friction first."""
    bench = 'seed = 3\n[[effects]]\nname = "coulomb_friction"\nforce_mn = 3.0\n'
    left = [rivals.left_of(t) for t in bench_trials(bench, campaign.plans(3)[:2])]
    by = rivals.by_information(left)
    assert by["AIC"].names[0] == by["BIC"].names[0] == "coulomb_friction"
    assert rivals.by_whiteness(left).names == ("something",)


def test_a_case_is_drawn_once_and_anew_where_another_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    times: list[str] = []

    class Drawn:
        def __init__(self, names: tuple[str, ...]) -> None:
            self.names = names

        def truth(self) -> dict[str, Any]:
            times.append("drawn")
            return {"kind": "single", "noise": "white", "hidden": [{"name": n} for n in self.names]}

    monkeypatch.setattr(campaign, "draw_case", lambda number, kind, names, *more, **rest: Drawn(names))
    for name in ("slip", "slip", "adhesion"):
        truth = campaign.drawn(0, ("single", (name,), "white"), "living", 1, tmp_path / "0.json")
        assert truth["hidden"] == [{"name": name}]
    assert len(times) == 2
