from __future__ import annotations

import json
from dataclasses import fields
from typing import Any

import pytest

from analysis.mismatch.name.own_sizes import Quantity
from analysis.mismatch.report.contents import Comparison, FoundMechanism, Report, Window
from analysis.mismatch.report.screen import show_report


def told(report: dict[str, Any]) -> Report:
    """Return the report that a report.json holds, as far as the screen needs it."""

    def quantities(found: dict[str, Any]) -> dict[str, Quantity]:
        return {name: Quantity(**value) for name, value in found.items()}

    values = {
        **{field.name: report[field.name] for field in fields(Report)},
        "mechanisms": tuple(
            FoundMechanism(**{**m, "parameters": quantities(m["parameters"])}) for m in report["mechanisms"]
        ),
        "mismatch": tuple(Window(**w) for w in report["mismatch"]),
        "heldout": Comparison(**report["heldout"]),
        "baseline_parameters": quantities(report["baseline_parameters"]),
        "improved_parameters": quantities(report["improved_parameters"]),
        "left_out": ("broken.h5: no trial file",),
    }
    return Report(**values)


def test_verdict_and_effects_stand_on_the_screen(
    clinging: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "120")
    show_report(told(json.loads((clinging.out / "report.json").read_text())))
    captured = capsys.readouterr()
    assert captured.out == ""  # what a script reads is the path alone
    assert "named: Found what the simulation left out" in captured.err
    assert "left out: broken.h5: no trial file" in captured.err
    effect = next(line for line in captured.err.splitlines() if line.startswith(" adhesion"))
    (said,) = (m for m in clinging.report["mechanisms"] if m["name"] == "adhesion")
    size = said["parameters"]["pull_off_mn"]
    assert f"pull off {size['value']:.2f} ± {size['se']:.2f} mN" in effect
    assert "< 0.0001" in effect
    assert "retract" in captured.err


def test_no_mismatch_needs_no_table(plain: Any, capsys: pytest.CaptureFixture[str]) -> None:
    show_report(told(plain.report))
    shown = capsys.readouterr().err
    assert shown.startswith("no_mismatch: The simulation explains the recordings")
    assert "rms" in shown
    assert "─" not in shown
