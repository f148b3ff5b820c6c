"""Every word of every view can be read, on a small screen and on a 4K one, whatever the names are like."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtWidgets import (
    QApplication,
    QComboBox,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QPushButton,
    QTableWidget,
    QTableWidgetItem,
    QWidget,
)
from pytestqt.qtbot import QtBot

from analysis.recordings import write_trial
from analysis.simulation.mechanism import library
from rig.engine.progress import (
    BenchFacts,
    CalibrationInUse,
    CalibrationShown,
    MeasuredConstant,
    Snapshot,
)
from rig.engine.prompts import Prompt
from rig.engine.states import State
from rig.gui.bench_state import BenchState
from rig.gui.cut_off import cut_off
from rig.gui.habits import Habits
from rig.gui.jobs.comparing import Comparison, Offer, run_diagnosis
from rig.gui.jobs.report_file import read_diagnosis
from rig.gui.pages.mismatch import MismatchPage
from rig.gui.shortened import ShortenedLabel
from rig.gui.window import Window

LONG = "a long word of what went wrong with this rig, and where, and what to do about it now, " * 3
FACTS = BenchFacts(
    rig="the bench in the cellar of the old building, left of the door",
    simulated=False,
    travel_min_mm=0.0,
    travel_max_mm=10.0,
    safe_position_mm=0.5,
    force_max_mn=400.0,
    sample_rate_hz=8000.0,
    calibrations=(CalibrationInUse("position", "2025-01-01T12:00:00+00:00", "2025-02-01T12:00:00+00:00"),),
)
RUN = Snapshot(
    title="study",
    state=State.HOLDING,
    trial="086_middle_0.40mm_r10",
    trial_number=186,
    n_trials=200,
    done_s=12_345.0,
    left_s=34_567.0,
    out="/data/the study of the spring of 2026 with the new lever/subject_017_session_03",
    file="086_middle_0.40mm_r10_again12.h5",
    surface_mm=3.4567,
    overshoot_um=12.3,
    n_lost=1_234_567,
    pausing=True,
    bench=FACTS,
)
FOUND = CalibrationShown(
    "force",
    "weight (mN)",
    tuple((10.0 * i, 0.12345 * i) for i in range(7)),
    tuple(MeasuredConstant(name, -0.0123456, 0.0001, -0.02) for name in ("volts_per_mn", "force_zero_v")),
    0.99999999,
    "waiting",
)
STATES = {
    "nothing": BenchState(),
    "idle": BenchState(link="open", snapshot=Snapshot(title="", state=State.IDLE, bench=FACTS)),
    "holding": BenchState(link="open", snapshot=RUN, asked=frozenset({"stop", "pause", "repeat", "discard"})),
    "resting": BenchState(link="open", snapshot=replace(RUN, state=State.RESTING, rest_left_s=5999.0)),
    "asking": BenchState(
        link="open",
        snapshot=replace(
            RUN, state=State.PREPARING, prompt=Prompt("1", "mass", LONG[:150], "number", "g", 12.5)
        ),
    ),
    "failed": BenchState(link="open", snapshot=replace(RUN, state=State.FAILED, error=LONG)),
    "dead": BenchState(link="died", snapshot=RUN, trouble=LONG),
    "calibrated": BenchState(link="open", snapshot=replace(RUN, state=State.IDLE, calibration=FOUND)),
}


def long_findings(report: dict[str, Any]) -> dict[str, Any]:
    """The changes that make a report as long-winded as the library's names and the physics allow."""
    names = sorted(library(), key=len)[-4:]
    mechanism = report["mechanisms"][0] | {
        "share_of_mismatch": 0.987,
        "alternatives": names,
        "alternative_probabilities": dict.fromkeys(names, 0.123),
        "explanation": LONG,
    }
    window = report["mismatch"][0] | {"start_s": 123.45, "stop_s": 234.56, "conditions": LONG}
    hidden = report["not_identifiable"][0]
    far = {name: value | {"value": 12345.678} for name, value in report["baseline_parameters"].items()}
    return {
        "summary": LONG,
        "mechanisms": [mechanism | {"name": name} for name in names],
        "mismatch": [window | {"phase": phase} for phase in ("approach", "dwell", "hold", "retract")],
        "not_identifiable": [hidden | {"name": name, "reason": LONG} for name in names],
        "baseline_parameters": far,
        "improved_parameters": far,
        "next_experiment": report["next_experiment"] | {"reason": LONG},
    }


def show_diagnosis(page: MismatchPage, folder: Path) -> None:
    """Show a diagnosis and a trial beside its simulation, with a second one under way."""
    found = read_diagnosis(folder)
    page.findings.show_diagnosis(found, lambda: None, lambda: None)
    page._set_running(True)
    page._tick()
    page.comparison.offer(Offer((f"/a/{'very_long_' * 12}name.h5",), {}), found.report.mismatch)
    t = np.linspace(0.0, 10.0, 50)
    compared = Comparison("", t, 40 * t, 39 * t, 40.1 * t, 12.345, 1.234, (LONG,), {"hold": 1.0})
    page.comparison.show_comparison(compared)


def lasting(window: Window) -> list[str]:
    """Return what is cut off once the layout has caught up: a preview that arrives meanwhile has it laid out anew."""
    found: list[str] = []
    for _ in range(3):
        for _ in range(3):
            QApplication.processEvents()
        found = cut_off(window)
        if not found:
            break
    return found


def faults(folder: Path, diagnosis: Path, width: int, height: int, themes: tuple[str, ...]) -> Iterator[str]:
    """Yield what can't be read in a window of that size, in any state and on any page."""
    window = Window(Habits(folder / "habits.json"), folder / "logs")
    window.show()
    show_diagnosis(window.mismatch, diagnosis)
    window.study._bar.ask(Path(f"086_middle_0.40mm_r10_{'again_' * 12}12.h5"))
    for theme in themes:
        window.take_theme(theme)
        for name, state in STATES.items():
            window.resize(width, height)
            window._show_state(state)
            window.say(f"{LONG} /a/{'very_long_' * 20}name.h5", "bad" if state.trouble else "note")
            for page in window.shell.pages:
                window.shell.show_page(page)
                where = f"{theme}, {name}, {page}: "
                yield from (where + fault for fault in lasting(window))
                if (window.width(), window.height()) != (width, height):
                    yield f"{where}the window has grown to {window.width()} x {window.height()}"
    window.close()


@pytest.fixture
def long_diagnosis(diagnosis: Callable[..., Path], report: dict[str, Any], tmp_path: Path) -> Path:
    return diagnosis(tmp_path / "diagnosis", **long_findings(report))


def test_nothing_is_cut_off_at_1366_by_768(long_diagnosis: Path, tmp_path: Path, qapp: QApplication) -> None:
    assert list(faults(tmp_path, long_diagnosis, 1366, 768, ("light", "dark"))) == []


def test_nothing_is_cut_off_on_a_4k_screen(long_diagnosis: Path, tmp_path: Path) -> None:
    """At twice the size, which Qt takes at the start of a program alone."""
    env = os.environ | {"QT_SCALE_FACTOR": "2", "QT_QPA_PLATFORM": "offscreen"}
    done = subprocess.run(
        [sys.executable, __file__, str(tmp_path), str(long_diagnosis)],
        env=env,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["scale 2.0"]


@pytest.mark.slow
@pytest.mark.parametrize(("size", "scale"), [("1366x768", "1"), ("1920x1080", "2")])
def test_a_session_at_the_bench_shows_every_word(size: str, scale: str, tmp_path: Path) -> None:
    """The command that makes the pictures looks at every page as it is photographed."""
    command = [sys.executable, "-m", "rig.gui.screenshots", str(tmp_path), "--size", size]
    env = os.environ | {"QT_SCALE_FACTOR": scale, "QT_QPA_PLATFORM": "offscreen"}
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    assert len(list(tmp_path.glob("*.png"))) == 13


@pytest.fixture(scope="module")
def clinging(_bench_trials: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight trials of skin that clings, and in their folder the diagnosis of them."""
    from sim_hardware.concealment.offline import study_plans

    folder = tmp_path_factory.mktemp("clinging")
    bench = 'seed = 5\n[[effects]]\nname = "adhesion"\npull_off_mn = 6.0\nrough = 0.0\n'
    plans = study_plans(("index",), (0.3, 0.6), 4, hold_s=3.0, dwell_s=0.5, rest_s=10.0)
    for i, trial in enumerate(_bench_trials.bench_trials(bench, plans)):
        write_trial(folder / f"{i}.h5", trial)
    return run_diagnosis([folder], folder / "diagnosis", "ramp")


@pytest.mark.slow
@pytest.mark.parametrize(("size", "scale"), [("1276x690", "1"), ("1830x990", "2")])
def test_a_real_diagnosis_shows_every_word(clinging: Path, size: str, scale: str, tmp_path: Path) -> None:
    """As above, in both looks: the pages that need no bench, in what a window leaves to a page."""
    command = [sys.executable, "-m", "rig.gui.page_screenshots", str(tmp_path), "--size", size]
    command += ["--trials", str(clinging.parent), "--diagnosis", str(clinging)]
    env = os.environ | {"QT_SCALE_FACTOR": scale, "QT_QPA_PLATFORM": "offscreen"}
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    assert len(list(tmp_path.glob("mismatch*.png"))) == 6


@pytest.mark.parametrize(
    ("make", "wide_px"),
    [
        (lambda: QLabel("some words on one line"), 60),
        (lambda: QPushButton("some words on one line"), 60),
        (lambda: _combo("some words on one line"), 60),
        (lambda: _wrapped("a_word_that_can_not_be_broken_anywhere"), 60),
        (lambda: _table("0.00000 ± 0.00000"), 60),
        (lambda: _plot("force in its unit (mN)"), 600),
        (lambda: _wrapped("many words that need many lines " * 20), 150),
    ],
)
def test_what_does_not_fit_is_found(make: Callable[[], QWidget], wide_px: int, qtbot: QtBot) -> None:
    box = QWidget()
    qtbot.addWidget(box)
    inside = make()
    inside.setParent(box)
    inside.resize(600, 200)
    box.show()
    assert cut_off(box) == []
    inside.resize(wide_px, 30)
    assert len(cut_off(box)) >= 1


def test_a_line_of_any_length_widens_nothing_and_is_whole_in_its_tool_tip(qtbot: QtBot) -> None:
    box = QWidget()
    qtbot.addWidget(box)
    label = ShortenedLabel("which file")
    QHBoxLayout(box).addWidget(label)
    box.resize(200, 40)
    box.show()
    label.setText("one\ntwo " + "x" * 1000)
    QApplication.processEvents()
    assert box.width() == 200
    assert box.minimumSizeHint().width() < 200
    assert label.text() == "one two " + "x" * 1000
    assert label.toolTip() == "which file\n" + label.text()
    long = label.grab().toImage()
    label.setText("one\ntwo " + "y" * 1000)
    assert label.grab().toImage() != long, "what fits is drawn"


def _combo(text: str) -> QComboBox:
    combo = QComboBox()
    combo.addItem(text)
    return combo


def _plot(text: str) -> pg.PlotWidget:
    plot = pg.PlotWidget()
    plot.setLabel("left", text)
    return plot


def _table(text: str) -> QTableWidget:
    table = QTableWidget(1, 1)
    table.setItem(0, 0, QTableWidgetItem(text))
    table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
    return table


def _wrapped(text: str) -> QLabel:
    label = QLabel(text)
    label.setWordWrap(True)
    return label


if __name__ == "__main__":
    application = QApplication([])
    print("scale", application.devicePixelRatio())
    for one in faults(Path(sys.argv[1]), Path(sys.argv[2]), 1920, 1080, ("light", "dark")):
        print(one)
