"""The position wizard in the real window, on the simulated rig in real time, by a person's hands."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import Qt

from rig.calibration.kept import load_calibration

LONG_MS = 900_000


@pytest.mark.slow
def test_position_is_calibrated_accepted_and_in_use(drive: Any) -> None:
    window, page = drive.window, drive.window.calibration
    shown = lambda: window.link.state.snapshot.calibration  # noqa: E731
    window.shell.show_page("Calibrate")
    assert "position: " in page._in_use.text()
    drive.click("Calibrate position", page)
    assert "stiff block" in page._title.text()
    page.by_bench.setChecked(False)
    drive.click("Start", page)
    asked: list[str] = []
    lines: set[str] = set()

    def measured() -> bool:
        lines.add(page._line_words.text())
        return shown() is not None and shown().decision == "waiting"

    while not measured():
        drive.qtbot.waitUntil(
            lambda: measured() or window.shell.banner.stands or bool(window.link.state.snapshot.error),
            timeout=LONG_MS,
        )
        assert not window.link.state.snapshot.error, drive.log()
        if window.shell.banner.stands:
            asked.append(window.shell.banner._words.text())
            time.sleep(0.7)  # an Enter that was on its way answers nothing
            page.setFocus()
            drive.press(Qt.Key.Key_Return)
            drive.until(lambda: not window.shell.banner.stands)
    assert any("block" in words for words in asked)
    found = shown()
    assert len(found.points) == 6, "the line is that of the heights' means"
    assert found.r2 > 0.9999
    x, y = page._points.getData()
    assert len(x) == len(y) == 6
    for n in (9, 16, 23):
        assert any(line.startswith(f"{n} points   slope") for line in lines), "the line as the points come"
    assert page._table.rowCount() == len(found.constants) > 0
    assert "accept it?" in page._running.text()
    assert not list((drive.folder / "calibrations").glob("*.json")), "nothing is kept before it is accepted"
    drive.click("Accept", page)
    drive.until(lambda: shown() is not None and shown().decision == "kept")
    kept = load_calibration(Path(shown().file))
    assert kept.kind == "position"
    drive.until(lambda: "the rig is opened again, with the new calibration" in drive.log())
    drive.until(lambda: window.link.state.ready and window.link.state.snapshot.bench is not None)
    in_use = {item.kind: item for item in window.link.state.snapshot.bench.calibrations}
    assert in_use["position"].calibrated == kept.calibrated
    assert in_use["force"].calibrated == ""
