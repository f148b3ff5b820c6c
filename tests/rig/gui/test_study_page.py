"""The page of a study shows its own folder's trials, and no other's."""

from __future__ import annotations

import shutil
from pathlib import Path

from pytestqt.qtbot import QtBot

from rig.gui.habits import Habits
from rig.gui.pages.study import StudyPage
from rig.gui.worker import Worker
from rig.protocols.planning import plan_of
from rig.settings.reading import parse_protocol

STUDY = 'kind = "study"\n[study]\nfingers = ["index"]\ndepths_mm = [0.4]\nrepeats = 1\n'


def test_what_is_read_of_a_folder_is_not_another_ones(
    worker: Worker, habits: Habits, study_folder: Path, tmp_path: Path, qtbot: QtBot
) -> None:
    page = StudyPage(worker, habits)
    qtbot.addWidget(page)
    protocol, begun = tmp_path / "study.toml", tmp_path / "begun"
    protocol.write_text(STUDY)
    begun.mkdir()
    shutil.copy(protocol, begun / "protocol.toml")
    (trial,) = plan_of(parse_protocol(STUDY, "study.toml"), 0.5).trials
    shutil.copy(study_folder / "index_0.40mm_r1.h5", begun / f"{trial.name}.h5")
    assert page.load(protocol, begun)
    assert page.load(protocol, tmp_path / "new")  # before the worker has read what the other holds
    done: list[object] = []
    worker.ask("a job after it", len, "", then=done.append)
    qtbot.waitUntil(lambda: bool(done), timeout=30_000)
    assert [row.state for row in page.table.rows] == ["to do"]
    assert page.load(protocol, begun)
    qtbot.waitUntil(lambda: page.table.n_done() == 1, timeout=30_000)
