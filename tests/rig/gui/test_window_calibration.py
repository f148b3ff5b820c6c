"""The position wizard in the real window, on the simulated rig in real time, by a person's hands."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import Qt

from rig.calibration.kept import load_calibration

LONG_S = 900.0


@pytest.mark.slow
def test_position_is_calibrated_accepted_and_in_use(drive: Any) -> None:
    window, page = drive.window, drive.window.calibration
    shown = lambda: window.link.state.snapshot.calibration  # noqa: E731
    window.shell.show_page("Calibrate")
    assert "position: " in page._in_use.text()
    drive.click("Calibrate position", page)
    assert "The stiff block" in page._text.text() or "stiff block" in page._title.text()
    page.by_bench.setChecked(False)
    drive.click("Start", page)
    asked, deadline = [], time.monotonic() + LONG_S
    while shown() is None or shown().decision != "waiting":
        assert time.monotonic() < deadline, drive.log()
        drive.until(lambda: window.shell.banner.stands or drive.at_rest() or _grows(page))
        if window.shell.banner.stands:
            asked.append(window.shell.banner._words.text())
            time.sleep(0.7)  # an Enter that was on its way answers nothing
            page.setFocus()
            drive.press(Qt.Key.Key_Return)
            drive.until(lambda: not window.shell.banner.stands)
        assert not window.link.state.snapshot.error
    assert any("block" in words for words in asked)
    found = shown()
    assert len(found.points) == 24
    assert found.r2 > 0.9999
    x, y = page._points.getData()
    assert len(x) == len(y) == 24
    assert "24 points" in page._line_words.text()
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


def _grows(page: Any) -> bool:
    """Whether a point has come since this was asked last."""
    n = 0 if page._points.getData()[0] is None else len(page._points.getData()[0])
    grown = n != getattr(_grows, "n", 0)
    _grows.n = n  # type: ignore[attr-defined]
    return grown
