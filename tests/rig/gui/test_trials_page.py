from __future__ import annotations

import shutil
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import QMimeData, QPointF, Qt, QUrl
from PySide6.QtGui import QDropEvent
from pytestqt.modeltest import ModelTester
from pytestqt.qtbot import QtBot

from analysis.recordings import read_trial
from analysis.relaxation.result import TrialFit
from rig.gui.folder_reading import FolderReading
from rig.gui.habits import Habits
from rig.gui.jobs.headers import Header
from rig.gui.pages.trials import TrialsPage
from rig.gui.theme import DARK
from rig.gui.trial_table import COLUMNS, Row, TrialFilter, TrialTable
from rig.gui.worker import Worker

LONG_MS = 180_000


def _header(i: int, **more: Any) -> Header:
    values: dict[str, Any] = {
        "finger": ("index", "thumb")[i % 2],
        "depth_mm": 0.2 * (i % 4 + 1),
        "status": "complete",
    }
    return Header(f"/study/{i:04d}.h5", 1, 1, **values | more)


def test_the_table_keeps_the_models_contract(qtmodeltester: ModelTester) -> None:
    table = TrialTable()
    shown = TrialFilter(table)
    qtmodeltester.check(table)
    qtmodeltester.check(shown)
    table.add([Row(f"/study/{i:04d}.h5") for i in range(30)])
    table.set_headers([_header(i) for i in range(40)])
    table.set_fits({"/study/0003.h5": TrialFit("0003.h5", "", "ramp", failure="no hold")})
    table.remove(["/study/0001.h5", "/study/0008.h5"])
    shown.look_for("index")
    shown.sort(2)
    assert table.rowCount() == 38
    assert table.row_of("/study/0039.h5") == 37
    table.clear()


def test_filter_and_sort() -> None:
    table = TrialTable()
    shown = TrialFilter(table)
    table.set_headers([_header(i) for i in range(8)] + [_header(8, discarded="the finger moved")])

    def names() -> list[str]:
        return [shown.index(i, 0).data() for i in range(shown.rowCount())]

    shown.look_for("INDEX -discarded")
    assert names() == ["0000", "0002", "0004", "0006"]
    shown.look_for('"finger moved"')
    assert names() == ["0008"]
    shown.look_for("")
    titles = [column.title for column in COLUMNS]
    shown.sort(titles.index("depth mm"), Qt.SortOrder.DescendingOrder)
    depths = [float(shown.index(i, titles.index("depth mm")).data()) for i in range(shown.rowCount())]
    assert depths == sorted(depths, reverse=True)


@pytest.fixture
def own_study(study_folder: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(study_folder, tmp_path / "own"))


@pytest.fixture
def page(worker: Worker, habits: Habits, qtbot: QtBot) -> Iterator[TrialsPage]:
    page = TrialsPage(worker, habits)
    qtbot.addWidget(page)
    page.resize(1276, 690)
    with qtbot.waitExposed(page):
        page.show()
    yield page
    page.hide()


def _opened(page: TrialsPage, folder: Path, n: int, qtbot: QtBot) -> None:
    page.open_folder(folder)

    def read() -> None:
        assert len(page.table.rows) == n
        assert all(row.header is not None for row in page.table.rows)

    qtbot.waitUntil(read, timeout=LONG_MS)


def test_an_empty_page_says_what_to_do(page: TrialsPage, tmp_path: Path, qtbot: QtBot) -> None:
    assert "Open a folder" in page._count.text()
    page.open_folder(tmp_path)
    qtbot.waitUntil(lambda: "No trial files" in page._count.text(), timeout=LONG_MS)
    page.open_folder(tmp_path / "gone")
    qtbot.waitUntil(lambda: "no such folder" in page._count.text(), timeout=LONG_MS)


def test_the_last_folder_is_open_again(
    worker: Worker, habits: Habits, study_folder: Path, qtbot: QtBot
) -> None:
    habits.used_folder("trials", study_folder)
    page = TrialsPage(worker, habits)
    qtbot.addWidget(page)
    page.show()
    qtbot.waitUntil(lambda: len(page.table.rows) == 6, timeout=LONG_MS)
    page.hide()


def test_browse_overlay_fit(page: TrialsPage, study_folder: Path, habits: Habits, qtbot: QtBot) -> None:
    _opened(page, study_folder, 6, qtbot)
    assert habits.folder("trials") == study_folder
    page._search.setText("index")
    page.view.selectAll()
    qtbot.waitUntil(lambda: len(page.overlay.plot.shown) == 4, timeout=LONG_MS)
    assert set(page.overlay.groups) == {"0.40 mm", "0.80 mm"}
    page.overlay._shown.setCurrentText("force over position")
    page.overlay._by.setCurrentText("by finger")
    qtbot.waitUntil(lambda: "4 of 4 trials drawn" in page.overlay._words.text(), timeout=LONG_MS)
    assert page.overlay.groups == ("index",) * 4
    page.restyle(DARK)
    page.commands.fit_again()
    qtbot.waitUntil(lambda: sum(row.fit is not None for row in page.table.rows) == 4, timeout=LONG_MS)
    page._tabs.setCurrentWidget(page.fit_panel)
    with qtbot.waitSignal(page.fit_panel.fitted, timeout=LONG_MS) as shown:
        page.view.selectRow(2)
    path, row = shown.args
    assert path.stem == "index_0.80mm_r1"
    texts = {
        page.fit_panel._table.item(i, 0).text(): page.fit_panel._table.item(i, 2).text() for i in range(6)
    }
    a0 = np.mean([r.fit.estimates["A0_mn"].value for r in page.table.rows[2:4] if r.fit])
    assert float(texts["A0, mN"].split(" ± ")[0]) == pytest.approx(a0, rel=0.01)
    assert page.fit_panel._table.item(0, 3).text() == "2"
    assert row.fitted


def test_what_is_chosen_before_it_is_read_is_drawn(
    page: TrialsPage, study_folder: Path, qtbot: QtBot
) -> None:
    page.open_folder(study_folder)
    qtbot.waitUntil(lambda: len(page.table.rows) == 6, timeout=LONG_MS)
    page.view.selectAll()
    qtbot.waitUntil(lambda: len(page.overlay.plot.shown) == 6, timeout=LONG_MS)


def test_looking_closer_shows_every_sample(page: TrialsPage, study_folder: Path, qtbot: QtBot) -> None:
    _opened(page, study_folder, 6, qtbot)
    page.view.selectRow(0)
    plot = page.overlay.plot
    qtbot.waitUntil(lambda: len(plot.shown) == 1, timeout=LONG_MS)
    path = plot.shown[0]
    coarse = plot._drawn[path].trace
    plot._item.vb.setXRange(1.0, 1.05, padding=0)
    plot._item.vb.sigRangeChangedManually.emit([True, False])
    qtbot.waitUntil(lambda: plot._drawn[path].trace is not coarse, timeout=LONG_MS)
    fine = plot._drawn[path].trace
    assert np.median(np.diff(fine.x)) == pytest.approx(1 / 8000, rel=0.01)


def test_discard_with_a_reason_and_undo(page: TrialsPage, own_study: Path, qtbot: QtBot) -> None:
    _opened(page, own_study, 6, qtbot)
    page.commands.ask_reason()
    assert "Choose the trials" in page.commands._words.text()
    page.view.selectRow(1)
    page.commands.ask_reason()
    assert page.commands._bar.isVisible()
    page.commands.discard()
    assert "needs a reason" in page.commands._question.text()
    qtbot.keyClicks(page.commands._reason, "the finger moved")
    path = Path(page.selected()[0].path)
    with qtbot.waitSignal(page.commands.marked, timeout=LONG_MS):
        qtbot.keyClick(page.commands._reason, Qt.Key.Key_Return)
    assert read_trial(path).discarded == "the finger moved"
    assert page.table.rows[1].header is not None
    assert page.table.rows[1].header.discarded == "the finger moved"
    with qtbot.waitSignal(page.commands.marked, timeout=LONG_MS):
        page.commands.undo()
    assert read_trial(path).discarded == ""


def test_dropped_files_are_opened_and_imported(
    page: TrialsPage, study_folder: Path, tmp_path: Path, qtbot: QtBot
) -> None:
    text = "time_s,position_mm,force_mn\n" + "".join(
        f"{i / 100},{min(i, 100) / 100},{min(i, 100)}\n" for i in range(400)
    )
    (tmp_path / "other.csv").write_text(text)
    trial = shutil.copy(sorted(study_folder.glob("*.h5"))[0], tmp_path / "one.h5")
    data = QMimeData()
    data.setUrls([QUrl.fromLocalFile(str(tmp_path / "other.csv")), QUrl.fromLocalFile(str(trial))])
    page.dropEvent(
        QDropEvent(
            QPointF(5, 5),
            Qt.DropAction.CopyAction,
            data,
            Qt.MouseButton.LeftButton,
            Qt.KeyboardModifier.NoModifier,
        )
    )
    names = {"one", "other"}
    qtbot.waitUntil(lambda: {Path(row.path).stem for row in page.table.rows} == names, timeout=LONG_MS)
    qtbot.waitUntil(lambda: len(page.overlay.plot.shown) == 2, timeout=LONG_MS)
    assert (tmp_path / "imported" / "other.h5").exists()


def test_a_file_on_which_the_reader_dies_is_found(
    own_study: Path, tmp_path: Path, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process ends itself on one file of six, as HDF5 may on a damaged one."""
    (tmp_path / "dying_reader.py").write_text(
        """
import os
from rig.gui.jobs.headers import Header

def read_first_headers(paths, within_s):
    if any("index_0.80mm_r1" in path for path in paths):
        os._exit(9)
    return tuple(Header(path, 1, 1) for path in paths)
"""
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(
        "rig.gui.folder_reading.read_first_headers", import_module("dying_reader").read_first_headers
    )
    worker = Worker()
    reading = FolderReading(worker)
    found: dict[str, Header] = {}
    reading.headers.connect(lambda headers: found.update({Path(h.path).stem: h for h in headers}))
    with qtbot.waitSignal(reading.done, timeout=LONG_MS):
        reading.read(own_study)
    worker.close()
    assert len(found) == 6
    assert [name for name, h in found.items() if h.problem] == ["index_0.80mm_r1"]
    assert "died" in found["index_0.80mm_r1"].problem


def test_curves_can_be_clicked(page: TrialsPage, study_folder: Path, qtbot: QtBot) -> None:
    _opened(page, study_folder, 6, qtbot)
    page.view.selectAll()
    plot = page.overlay.plot
    qtbot.waitUntil(lambda: len(plot.shown) == 6, timeout=LONG_MS)
    path = next(path for path in plot.shown if "index_0.80mm_r2" in path)
    trace = plot._drawn[path].trace
    at = int(np.argmax(trace.y))
    scene = plot._item.vb.mapViewToScene(QPointF(float(trace.x[at]), float(trace.y[at])))

    class Click:
        def scenePos(self) -> QPointF:  # noqa: N802
            return scene

    with qtbot.waitSignal(plot.picked) as picked:
        plot._clicked(Click())
    assert picked.args == [path]
    assert page.view.currentIndex().siblingAtColumn(0).data() == "index_0.80mm_r2"
    assert len(page.selected()) == 6
