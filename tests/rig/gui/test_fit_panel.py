from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtGui import QFontMetrics
from PySide6.QtWidgets import QSplitter, QTableWidget
from pytestqt.qtbot import QtBot

from analysis.recordings import write_trial
from rig.gui.fit_panel import FitPanel
from rig.gui.habits import Habits
from rig.gui.jobs.fitting import picture_fit
from rig.gui.worker import Worker


@pytest.fixture(scope="module")
def trials(tmp_path_factory: pytest.TempPathFactory, simulated_trial: Any) -> list[Path]:
    folder = tmp_path_factory.mktemp("trials")
    paths = []
    for number, trial in enumerate(simulated_trial(seed=3, repeats=2)):
        paths.append(folder / f"{number}.h5")
        write_trial(paths[-1], replace(trial, path=""))
    return paths


@pytest.mark.parametrize("wanted_px", [200, 380, 640])
def test_no_number_is_cut_off(
    wanted_px: int, trials: list[Path], worker: Worker, habits: Habits, qtbot: QtBot
) -> None:
    """However narrow the side of a page is asked to be."""
    panel, split = FitPanel(worker, habits), QSplitter()
    split.setChildrenCollapsible(False)
    split.addWidget(QTableWidget())
    split.addWidget(panel)
    qtbot.addWidget(split)
    split.resize(996, 690)
    with qtbot.waitExposed(split):
        split.show()
    split.setSizes([996 - wanted_px, wanted_px])
    panel.know({str(path): picture_fit(str(path), "ramp", 200).row for path in trials})
    panel._show(picture_fit(str(trials[0]), "ramp", 200))
    (table,) = panel.findChildren(QTableWidget)
    measure, shown = QFontMetrics(table.font()), 0
    for row in range(table.rowCount()):
        for column in range(table.columnCount()):
            item = table.item(row, column)
            if item is not None and item.text():
                shown += 1
                assert measure.horizontalAdvance(item.text()) + 6 <= table.columnWidth(column), item.text()
    assert shown == 4 * table.rowCount()
