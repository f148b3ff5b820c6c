"""The real window drives the simulated rig in real time: connect, run, abort, discard, repeat, resume, die."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from typing import Any

import pytest
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QComboBox, QMenu, QMessageBox

from analysis.recordings import read_trial
from rig.commands.safe import make_safe
from rig.engine.states import State
from rig.gui.window import Window
from rig.settings.reading import load_rig


def test_it_connects_and_shows_the_arm_at_rest(drive: Any) -> None:
    window = drive.window
    drive.until(lambda: window.link.bins is not None and window.link.bins.next_sample > 8000)
    assert window.link.state.simulated
    assert window.shell.header._rig.text() == "SIMULATED RIG"
    window.shell.show_page("Live")
    drive.until(lambda: "0.5" in window.readouts._position.text())
    x, y = window.live.plot._curves[0].getData()
    assert len(x) > 100
    assert abs(y[-1] - 0.5) < 0.1
    assert "connected" in drive.log()


def test_a_trial_by_hand_is_run_shown_and_fitted(drive: Any) -> None:
    window = drive.window
    out = drive.load("by_hand", hold=1.5)
    drive.start(by_bench=False)
    drive.until(lambda: window.shell.banner.stands)
    assert "Place the index finger" in window.shell.banner._words.text()
    time.sleep(0.7)  # an Enter that was on its way answers nothing
    window.study._view.setFocus()
    drive.press(Qt.Key.Key_Return)
    drive.until(lambda: drive.state is State.HOLDING)
    assert window.shell.header._file.text() == "writing by_hand/001_index_0.30mm_r1.h5"
    drive.until(drive.at_rest)
    drive.until(lambda: window.study.table.rows[0].a0_mn)
    assert read_trial(out / "001_index_0.30mm_r1.h5").status == "complete"
    assert window.study.table.rows[0].state == "complete"
    assert window.link.state.snapshot.n_lost == 0
    names = [mark.name for mark in window.link.marks]
    assert {"approach", "dwell", "ramp", "hold", "retract"} <= set(names)


@pytest.mark.parametrize("when", [State.APPROACHING, State.RAMPING, State.HOLDING])
def test_esc_takes_the_arm_off_the_skin(drive: Any, when: State) -> None:
    window = drive.window
    slow = 0.3 if when is State.APPROACHING else 2.0
    out = drive.load(f"esc_{when}", approach=slow)
    drive.start()
    drive.until(lambda: drive.state is when)
    drive.press(Qt.Key.Key_Escape)
    drive.until(drive.at_rest)
    assert "abort: done, the arm rests at the safe position" in window.shell._status.text()
    trial = read_trial(out / "001_index_0.30mm_r1.h5")
    assert trial.status == "aborted"
    assert "stopped by the operator" in trial.status_reason
    drive.until(lambda: "0.5" in window.readouts._position.text())
    window.shell.clear()


def test_esc_reaches_the_arm_from_wherever_the_focus_is(drive: Any) -> None:
    window = drive.window
    heard: list[float] = []
    real, window.keys._abort = window.keys._abort, lambda: heard.append(time.monotonic())
    window.keys._running = lambda: True
    try:
        for n, (what, undo) in enumerate(_situations(window), start=1):
            widget = what()
            QApplication.processEvents()
            QTest.keyClick(widget or QApplication.focusWidget() or window, Qt.Key.Key_Escape)
            assert heard, f"situation {n}: {widget}"
            heard.clear()
            undo()
            QTest.qWait(20)
            assert QApplication.activePopupWidget() is None, f"situation {n}: undone"
            assert QApplication.activeModalWidget() is None, f"situation {n}: undone"
    finally:
        window.keys._abort = real
        window.keys._running = lambda: window.link.state.running


def _situations(window: Window) -> list[tuple[Callable[[], Any], Callable[[], Any]]]:
    study, trials = window.study, window.trials
    menu, box = QMenu(window), QMessageBox(window)
    menu.addAction("something")
    combo = window.live.findChild(QComboBox)

    def page(name: str, focus: Any) -> Callable[[], Any]:
        def go() -> Any:
            window.shell.show_page(name)
            focus.setFocus()
            return focus

        return go

    def nothing() -> None:
        return None

    found: list[tuple[Callable[[], Any], Callable[[], Any]]] = [
        (page("Live", window.live), nothing),
        (page("Live", combo), nothing),
        (lambda: (combo.showPopup(), combo.view())[1], combo.hidePopup),  # type: ignore[union-attr]
        (page("Study", study._view), nothing),
        (lambda: (study._bar.show(), study._bar.field)[1], study._bar.hide),
        (page("Log", window.log.view), nothing),
        (page("Trials", trials), nothing),
        (page("Calibrate", window.calibration._start), nothing),
        (lambda: (menu.popup(QPoint(10, 10)), menu)[1], menu.close),
        (lambda: (box.open(), box)[1], lambda: box.done(0)),
    ]
    return found


def test_discard_restore_and_repeat(drive: Any) -> None:
    window = drive.window
    out = drive.load("again", hold=0.5, repeats=2)
    drive.start()
    drive.until(lambda: drive.state is State.RESTING or window.link.state.snapshot.trial_number == 2)
    first = out / "001_index_0.30mm_r1.h5"
    window.study._view.selectRow(0)
    drive.press(Qt.Key.Key_D, Qt.KeyboardModifier.ControlModifier)
    assert window.study._bar.isVisible()
    QTest.keyClick(window.study._bar.field, Qt.Key.Key_Return)
    window.study._view.selectRow(0)
    drive.press(Qt.Key.Key_R, Qt.KeyboardModifier.ControlModifier)
    drive.until(drive.at_rest)
    assert read_trial(first).discarded == "the finger moved"
    assert read_trial(out / "001_index_0.30mm_r1_again2.h5").status == "complete"
    assert [row.state for row in window.study.table.rows] == ["complete", "complete"]
    # nothing runs now: the window itself marks, and takes back
    second = out / "002_index_0.30mm_r2.h5"
    window.commands.discard(second, "bad contact")
    drive.until(lambda: window.study.table.rows[1].state == "discarded")
    window.commands.restore(second)
    drive.until(lambda: window.study.table.rows[1].state == "complete")
    assert read_trial(second).discarded == ""


def test_pause_retreat_and_go_on(drive: Any) -> None:
    window = drive.window
    out = drive.load("pause", hold=3.0, repeats=2)
    drive.start()
    drive.until(lambda: drive.state is State.HOLDING)
    window.actions_by_name["Retreat"].trigger()
    drive.until(lambda: drive.state is State.PAUSED)
    assert read_trial(out / "001_index_0.30mm_r1.h5").status == "aborted"
    assert window.actions_by_name["Go on"].isEnabled()
    window.actions_by_name["Go on"].trigger()
    drive.until(lambda: drive.state is State.HOLDING)
    drive.question.answer = "Stop the run"
    window.actions_by_name["Stop"].trigger()
    drive.until(drive.at_rest)


def test_a_study_of_another_calibration_is_asked_about_first(drive: Any) -> None:
    window = drive.window
    out = drive.load("another", hold=0.3)
    out.mkdir()
    begun_with = out / "rig.json"
    begun_with.write_text(f'{{"rig": "{load_rig(drive.folder / "rig.toml").name}", "constants": {{}}}}')
    drive.question.answer = "Don't start"
    drive.start()
    drive.until(lambda: drive.question.asked)
    assert "recorded with another calibration" in drive.question.asked[0]
    drive.until(lambda: window.link.state.ready)
    assert not list(out.glob("*.h5"))
    drive.question.answer = "Go on with this one"
    drive.start()
    drive.until(lambda: window.study.table.n_done() == 1)
    assert len(drive.question.asked) == 2
    assert "volts_per_mm" in begun_with.read_text(), "the study goes on with the constants of today"


def test_an_abort_before_anything_is_recorded_says_so(drive: Any) -> None:
    window = drive.window
    out = drive.load("nothing_yet", hold=0.3)
    drive.start(by_bench=False)
    drive.until(lambda: window.shell.banner.stands)
    drive.press(Qt.Key.Key_Escape)
    drive.until(drive.at_rest)
    assert "abort: done" in window.shell._status.text()
    assert "no trial was being recorded" in window.shell._status.text()
    assert not list(out.glob("*.h5"))
    assert window.study.table.rows[0].state == "to do"
    # what an abort did stays, and yet a note on what was done since is seen
    window.say("a note", "note")
    assert window.shell._status.text() == "a note"
    window.shell._fading.setInterval(1)
    window.shell._fading.start()
    drive.until(lambda: "abort: done" in window.shell._status.text())
    window.say("written", "good")
    assert "abort: done" in window.shell._status.text()
    window.shell.clear()
    assert window.shell._status.text() == ""


def test_what_can_not_be_opened_stays_said_and_changes_nothing(drive: Any) -> None:
    window = drive.window
    rig, kept = window.rig, window.habits.rig
    window.connect_rig(drive.folder / "no.toml")
    assert "no such file" in window.shell._status.text()
    assert "rig.toml stays connected" in window.shell._status.text()
    assert (window.rig, window.habits.rig) == (rig, kept)
    assert window.link.state.ready
    typo = drive.folder / "typo.toml"
    typo.write_text('kind = "study"\n[study]\nrepeets = 2\n')
    assert not window.study.load(typo)
    assert "did you mean repeats?" in window.shell._status.text()
    window.shell._fade()
    assert "did you mean repeats?" in window.shell._status.text(), "it stays until it is put away"
    window.shell.clear()


def test_closing_in_a_run_asks_first(drive: Any) -> None:
    window = drive.window
    drive.load("closing")
    drive.start()
    drive.until(lambda: drive.state is State.HOLDING)
    drive.question.answer = "Stay"
    assert not window.close()
    assert window.isVisible()
    assert "A run is in progress" in drive.question.asked[-1]
    drive.press(Qt.Key.Key_Escape)
    drive.until(drive.at_rest)


def test_the_rigs_program_is_killed_and_the_study_is_gone_on_with(drive: Any) -> None:
    window = drive.window
    out = drive.load("killed", hold=3.0, repeats=2)
    drive.start()
    drive.until(lambda: window.link.state.snapshot.trial_number == 2 and drive.state is State.HOLDING)
    assert window.link.process is not None
    os.kill(window.link.process.pid, signal.SIGKILL)
    drive.until(lambda: window.link.state.link == "died")
    assert "has ended while holding: it was ended from outside (signal 9" in window.link.state.trouble
    assert "the guard takes the arm clear; 002_index_0.30mm_r2.h5 is kept" in drive.log()
    assert window.shell.header._file.text() == "no file is being written"
    drive.until(lambda: window.study.table.rows[1].state == "cut off")
    assert window.shell.header._doing.text() == "the rig's program has died"
    # the guard holds the bench until the arm is clear; another can be started all the same
    window.connect_rig(drive.folder / "rig.toml")
    drive.until(lambda: window.link.state.link == "open")
    assert window.study.load(drive.folder / "killed.toml", out)
    drive.until(lambda: window.study.table.rows[0].state == "complete" and window.link.state.ready)
    drive.start()
    drive.until(lambda: window.study.table.n_done() == 2)
    drive.until(drive.at_rest)
    assert read_trial(out / "002_index_0.30mm_r2_again2.h5").status == "complete"


def test_a_frozen_program_is_ended_by_an_abort(drive: Any) -> None:
    window = drive.window
    out = drive.load("frozen")
    drive.start()
    drive.until(lambda: drive.state is State.HOLDING)
    assert window.link.process is not None
    os.kill(window.link.process.pid, signal.SIGSTOP)
    drive.press(Qt.Key.Key_Escape)
    drive.until(lambda: window.link.state.link == "died")
    assert "does not obey" in drive.log()
    window.connect_rig(drive.folder / "rig.toml")
    drive.until(lambda: window.link.state.link == "open")
    assert (out / "001_index_0.30mm_r1.h5").exists(), "the file is kept, for rescue"


def test_keys_are_listed_from_the_actions(drive: Any) -> None:
    drive.window.shell.show_page("Live")
    drive.press(Qt.Key.Key_F1)
    keys = drive.question.asked[-1]
    for part in (
        "Esc: ABORT",
        "F5: start",
        "Ctrl+D: mark",
        "F: hold the view still",
        "Ctrl+2: page Protocol",
    ):
        assert part in keys


def test_two_looks(drive: Any) -> None:
    drive.window.take_theme("dark")
    dark = drive.window.live.plot._plots[0].backgroundBrush().color().lightness()
    drive.window.take_theme("light")
    light = drive.window.live.plot._plots[0].backgroundBrush().color().lightness()
    assert dark < 60
    assert light > 200


def test_a_program_killed_with_its_guards_leaves_the_arm_to_the_person_who_is_told(drive: Any) -> None:
    window = drive.window
    drive.load("alone", hold=30.0)
    drive.start()
    drive.until(lambda: drive.state is State.HOLDING)
    facts = window.link.state.snapshot.bench
    assert facts is not None
    assert len(facts.guards) == 2
    assert window.link.process is not None
    for pid in (*facts.guards, window.link.process.pid):
        os.kill(pid, signal.SIGKILL)
    drive.until(lambda: window.link.state.link == "died")
    assert "NO GUARD IS LEFT: LIFT THE ARM BY HAND" in drive.log()
    # as that person does: nobody holds the card then, and the next program comes to a clear arm
    make_safe(drive.folder / "rig.toml")
    window.connect_rig(drive.folder / "rig.toml")
    drive.until(lambda: window.link.state.link == "open" and window.link.state.ready)
