"""In the real window: a folder of trials is diagnosed, its twin becomes the rig, the next experiment is begun."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import Qt

from analysis.recordings import read_trial, write_trial
from rig.engine.states import State

DIAGNOSED_MS = 900_000


@pytest.mark.slow
def test_diagnosed_then_the_twin_then_the_next_experiment(
    drive: Any, simulated_trial: Callable[..., Any], tmp_path: Path
) -> None:
    window, page = drive.window, drive.window.mismatch
    for depth_mm in (0.3, 0.6):
        for trial in simulated_trial(7, "index", depth_mm, 4):
            write_trial(tmp_path / f"{depth_mm}_{trial.specimen.repeat}.h5", trial)
    window.shell.show_page("Mismatch")
    page.use_trials(tmp_path)
    drive.click("Diagnose", page)
    drive.qtbot.waitUntil(lambda: page.comparison.shown is not None, timeout=DIAGNOSED_MS)
    assert page.found.report.n_trials == 8
    assert page.found.figures

    drive.click("Use as simulated rig", page)
    assert window.rig == tmp_path / "diagnosis" / "twin.toml"
    drive.until(lambda: window.link.state.rig == "twin.toml" and window.link.state.ready)
    assert window.link.state.simulated
    assert window.shell.header._rig.text() == "SIMULATED RIG"

    drive.click("Run the next experiment", page)
    assert window.shell.page == "Study"
    assert window.study.protocol == tmp_path / "diagnosis" / "next.toml"
    assert len(window.study.table.rows) >= 8
    drive.start()
    drive.until(lambda: drive.state is State.HOLDING)
    drive.press(Qt.Key.Key_Escape)
    drive.until(drive.at_rest)
    recorded = list(window.study.out.glob("*.h5"))
    assert [read_trial(path).status for path in recorded] == ["aborted"]
    assert "next" in str(window.study.out)
