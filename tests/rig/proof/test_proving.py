"""The proof's course: seals first, trial files alone to the diagnosis, truths last."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any
from xmlrpc.client import Fault, ServerProxy

import pytest

from analysis.errors import BadInputError
from rig.errors import RigError
from rig.proof import keeper as proof_keeper
from rig.proof import proving as proof
from rig.proof.keeper import Keeper
from rig.settings.reading import load_rig

NULL_SEED = 3
"""The first case of every seed is a null: quick to draw."""
STUDY = [
    {"finger": "index", "site": str(i + 1), "repeat": 1, "depth_mm": depth_mm, "rest_s": 60.0}
    for i, depth_mm in enumerate((0.2, 0.4))
]


def test_seals_come_before_and_fit_what_is_opened() -> None:
    told: list[tuple[int, str]] = []
    with Keeper(1, NULL_SEED, STUDY, lambda number, seal: told.append((number, seal))) as keeper:
        assert told == [(0, keeper.seals[0])]
        (opened,) = keeper.open()
    assert hashlib.sha256(f"{opened.salt}\n{opened.text}".encode()).hexdigest() == told[0][1]
    assert opened.truth["kind"] == "null"
    assert len(opened.salt) == 64


def test_settings_are_handed_out_once_and_never_after_opening() -> None:
    with Keeper(1, NULL_SEED, STUDY, lambda number, seal: None) as keeper:
        service: Any = ServerProxy(keeper.address)
        assert json.loads(service.hand_out(0))["time"] == "virtual"
        with pytest.raises(Fault, match="handed out already"):
            service.hand_out(0)
        with pytest.raises(Fault, match="there are 1"):
            service.hand_out(7)


def test_a_second_bench_is_told_why_in_one_line() -> None:
    with Keeper(1, NULL_SEED, STUDY, lambda number, seal: None) as keeper:
        service: Any = ServerProxy(keeper.address)
        service.hand_out(0)
        command = [sys.executable, *keeper.companion(0)[1:]]
        ended = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False)
    assert ended.returncode == 2
    assert "handed out already" in ended.stderr
    assert ended.stderr.count("\n") == 1


def test_a_truth_that_does_not_fit_its_seal_voids_the_proof() -> None:
    with Keeper(1, NULL_SEED, STUDY, lambda number, seal: None) as keeper:
        keeper.seals[0] = "0" * 64
        with pytest.raises(RigError, match="does not fit its seal"):
            keeper.open()


def test_a_keeper_that_ends_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(proof_keeper, "MODULE", "sim_hardware.no_such_module")
    with pytest.raises(RigError, match="ended"), Keeper(1, 0, STUDY, lambda number, seal: None):
        pass


def test_a_folder_that_holds_something_is_refused(tmp_path: Path) -> None:
    (tmp_path / "there.txt").write_text("something")
    with pytest.raises(BadInputError, match="is there already"):
        proof.run_proof(cases=1, seed=0, out=tmp_path)


def test_course_of_a_proof(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The diagnosis is given trial files alone; no file tells what is concealed until all is diagnosed."""
    seen: list[str] = []
    out = tmp_path / "proof"

    def record(protocol: Path, *, rig: Path, out: Path) -> Path:
        companion = load_rig(rig).companion
        assert companion is not None
        assert companion.settings == {}
        assert "bench" in companion.command
        assert 'order = "shuffled"' in protocol.read_text()
        out.mkdir()
        return out

    def diagnose(trials: Path, folder: Path, seed: int) -> tuple[dict[str, Any] | None, str]:
        seen.append(trials.name)
        for file in out.rglob("*"):
            assert file.is_dir() or "tissue" not in file.read_text()
        return {"verdict": "no_mismatch", "mechanisms": [], "mismatch": [], "not_identifiable": []}, ""

    planned = proof.planned
    monkeypatch.setattr(proof, "planned", lambda path: planned(path)[:2])
    monkeypatch.setattr(proof, "run_protocol_file", record)
    monkeypatch.setattr(proof, "_diagnose", diagnose)
    page = proof.run_proof(cases=1, seed=NULL_SEED, out=out)
    assert seen == ["trials"]
    seals = json.loads((out / "seals.json").read_text())
    (opened,) = json.loads((out / "truths.json").read_text())
    assert hashlib.sha256(f"{opened['salt']}\n{opened['truth']}".encode()).hexdigest() == seals[0]
    found = json.loads((out / "proof.json").read_text())
    assert found["figures"][0] == {"what": "false alarms on nulls", "value": "0 of 1 (0.0%)", "over": 1}
    assert found["cases"][0]["right"] is True
    assert seals[0] in page.read_text()


def test_a_diagnosis_that_fails_is_counted_and_told(tmp_path: Path) -> None:
    (tmp_path / "trials").mkdir()
    report, failure = proof._diagnose(tmp_path / "trials", tmp_path / "diagnosis", 0)
    assert report is None
    assert "exit code 2" in failure


def test_a_bench_that_fails_is_counted_and_the_others_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def record(protocol: Path, *, rig: Path, out: Path) -> Path:
        raise RigError("the card is gone; plug it in")

    planned = proof.planned
    monkeypatch.setattr(proof, "planned", lambda path: planned(path)[:2])
    monkeypatch.setattr(proof, "run_protocol_file", record)
    page = proof.run_proof(cases=1, seed=NULL_SEED, out=tmp_path / "proof")
    found = json.loads((tmp_path / "proof" / "proof.json").read_text())
    assert found["cases"][0]["failure"] == "recording failed: the card is gone; plug it in"
    assert found["figures"] == []
    assert "plug it in" in page.read_text()


def test_the_keeper_is_told_the_study_that_will_be_recorded(tmp_path: Path) -> None:
    """Twenty trials on five fingers, each at a site of its own, with rests of two to three minutes."""
    study = tmp_path / "study.toml"
    study.write_text(proof._STUDY.format(seed=4))
    told = proof.planned(study)
    assert len(told) == 20
    assert len({(t["finger"], t["site"]) for t in told}) == 20
    assert {t["finger"] for t in told} == {"thumb", "index", "middle", "ring", "little"}
    assert sorted({t["depth_mm"] for t in told}) == [0.2, 0.4, 0.6, 0.8]
    assert told[0]["rest_s"] == 0.0
    assert all(120 <= float(t["rest_s"]) <= 180 for t in told[1:])
