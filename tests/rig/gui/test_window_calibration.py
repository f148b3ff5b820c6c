"""Both wizards in the real window, on the simulated rig in real time, by a person's hands."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import Qt

from rig.calibration.kept import load_calibration

LONG_MS = 900_000


def begun(drive: Any, kind: str, *, by_bench: bool = False) -> None:
    """Go through the wizard's first pages as far as Start."""
    window, page = drive.window, drive.window.calibration
    window.shell.show_page("Calibrate")
    drive.click(f"Calibrate {kind}", page)
    page.by_bench.setChecked(by_bench)
    drive.click("Start", page)
    # a calibration before this one waits to be decided no more
    drive.until(lambda: shown(drive) is not None and shown(drive).kind == kind and not shown(drive).decision)


def shown(drive: Any) -> Any:
    return drive.window.link.state.snapshot.calibration


def measured(drive: Any) -> tuple[list[str], list[str]]:
    """Answer what the bench asks until the result is there; what it asked, and the line at every point."""
    window, page = drive.window, drive.window.calibration
    asked: list[str] = []
    lines: list[str] = []

    def done() -> bool:
        text = page._line_words.text()
        if not lines or lines[-1] != text:
            lines.append(text)
        return shown(drive).decision == "waiting"

    while not done():
        drive.qtbot.waitUntil(
            lambda: done() or window.shell.banner.stands or bool(window.link.state.snapshot.error),
            timeout=LONG_MS,
        )
        assert not window.link.state.snapshot.error, drive.log()
        if window.shell.banner.stands:
            asked.append(window.shell.banner._words.text())
            standing = window.shell.banner._prompt
            time.sleep(0.7)  # an Enter that was on its way answers nothing
            page.setFocus()
            drive.press(Qt.Key.Key_Return)
            drive.until(lambda standing=standing: window.shell.banner._prompt != standing)
    return asked, lines


def accepted(drive: Any) -> Any:
    """Press Accept; return the file that was kept, once the rig is open again with it."""
    window = drive.window
    drive.click("Accept", window.calibration)
    drive.until(lambda: shown(drive) is not None and shown(drive).decision == "kept")
    kept = load_calibration(Path(shown(drive).file))
    drive.until(lambda: in_use(drive).get(kept.kind) == kept.calibrated and window.link.state.ready)
    assert "the rig is opened again, with the new calibration" in drive.log()
    drive.click("Close", window.calibration)
    return kept


def in_use(drive: Any) -> dict[str, str]:
    """When each of the constants that the open bench uses was measured; "" where never, {} without a bench."""
    bench = drive.window.link.state.snapshot.bench
    return {} if bench is None else {item.kind: item.calibrated for item in bench.calibrations}


def cells(page: Any) -> list[list[str]]:
    table = page._table
    return [[table.item(i, j).text() for j in range(table.columnCount())] for i in range(table.rowCount())]


@pytest.mark.slow
def test_position_is_calibrated_accepted_and_in_use(drive: Any) -> None:
    page = drive.window.calibration
    drive.window.shell.show_page("Calibrate")
    force_before = in_use(drive)["force"]
    assert "position: nominal constants" in page._in_use.text()
    begun(drive, "position")
    assert "stiff block" in page._title.text()
    asked, lines = measured(drive)
    assert any("block" in words for words in asked)
    found = shown(drive)
    assert len(found.points) == 6, "the line is that of the heights' means"
    assert found.r2 > 0.9999
    x, y = page._points.getData()
    assert len(x) == len(y) == 6
    for n in (9, 16, 23):
        assert any(line.startswith(f"{n} points   slope") for line in lines), "the line as the points come"
    assert page._table.rowCount() == len(found.constants) > 0
    assert "accept it?" in page._running.text()
    assert not list((drive.folder / "calibrations").glob("position*.json")), "nothing is kept before that"
    kept = accepted(drive)
    assert kept.kind == "position"
    assert in_use(drive)["force"] == force_before


@pytest.mark.slow
def test_force_is_calibrated_by_hanging_weights_and_held_against_the_last(drive: Any) -> None:
    page = drive.window.calibration
    begun(drive, "force")
    assert "Force: weights on the inverted arm" in page._title.text()
    assert not page._verdict.isVisible(), "nothing is said of a result before there is one"
    asked, lines = measured(drive)
    assert any("Turn the arm over" in words for words in asked)
    assert "Put 5 g on the balance" in asked
    assert "Clear the pan of the balance" in asked
    hung = {words.split()[1] for words in asked if words.startswith("Hang ")}
    assert hung == {"5", "10", "15", "20", "25", "30"}
    assert "Take all weights off the arm" in asked
    for n in (3, 8, 14):
        assert any(line.startswith(f"{n} points   slope") for line in lines), "the line as the points come"
    found = shown(drive)
    assert len(found.points) == 7, "the line is that of the weights' means"
    assert found.r2 > 0.999
    left_mv = page._left.getData()[1]
    assert len(left_mv) == 7
    assert abs(left_mv).max() < 0.02 * 1e3 * max(volts for _, volts in found.points)
    assert not list((drive.folder / "calibrations").glob("force*.json")), "nothing is kept before that"
    first = accepted(drive)
    assert first.kind == "force"

    # once more, by the bench's own hands: held against the one just accepted, and rejected
    assert f"force: measured {first.calibrated[:16].replace('T', ' ')}" in page._in_use.text()
    begun(drive, "force", by_bench=True)
    assert not page._verdict.isVisible()
    measured(drive)
    gain = next(row for row in cells(page) if row[0] == "volts_per_mn")
    assert gain[2] == f"{first.constants['volts_per_mn'].value:.6g}", "beside what is in use"
    assert abs(float(gain[3].removesuffix(" %"))) < 2.0
    assert "within 2 % of what is in use" in page._verdict.text()
    drive.click("Reject", page)
    drive.until(lambda: shown(drive).decision == "left")
    assert "the last one stays in use" in page._running.text()
    assert in_use(drive)["force"] == first.calibrated
    assert len(list((drive.folder / "calibrations").glob("force*.json"))) == 1
