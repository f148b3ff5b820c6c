"""The bench window: pages around one link to the bench, and everything that may be asked of it."""

from __future__ import annotations

import gc
import time
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import QByteArray, QTimer
from PySide6.QtGui import QAction, QCloseEvent
from PySide6.QtWidgets import QApplication, QMainWindow

from analysis.errors import BadInputError
from rig.gui.actions import make_actions, page_actions
from rig.gui.asking import ask_file
from rig.gui.bench_link import BenchLink
from rig.gui.bench_state import BenchState
from rig.gui.calibration_words import reminder
from rig.gui.habits import Habits
from rig.gui.jobs.marking import discard, take_back
from rig.gui.keys import KeyFilter
from rig.gui.pages.calibration import CalibrationPage
from rig.gui.pages.live import LivePage
from rig.gui.pages.log import LogPage
from rig.gui.pages.mismatch import MismatchPage
from rig.gui.pages.protocol import ProtocolPage
from rig.gui.pages.study import StudyPage
from rig.gui.pages.trials import TrialsPage
from rig.gui.questions import Ask, Choices, ask
from rig.gui.readouts import Readouts
from rig.gui.shell import Shell, restored
from rig.gui.simulated import rig_for_the_window
from rig.gui.theme import THEMES, apply_theme
from rig.gui.worker import Worker
from rig.settings.reading import load_rig

_READOUT_MS = 100


class Window(QMainWindow):
    """One window, one bench, one worker. ``question`` asks the person; tests answer in its place."""

    def __init__(self, habits: Habits, logs: Path, question: Ask = ask) -> None:
        super().__init__()
        self.setWindowTitle("indenter")
        self.habits, self._ask = habits, question
        self.rig: Path | None = None
        self.worker = Worker(self)
        self.link = BenchLink(logs / "bench.log", self)
        self._prompt_since: float | None = None
        self._may_close = False
        self.actions_by_name = self._make_actions()
        self.live, self.log = LivePage(self.link), LogPage(logs / "window.log")
        self.study = StudyPage(self.worker, habits)
        self.calibration = CalibrationPage()
        self.trials = TrialsPage(self.worker, habits)
        self.protocol = ProtocolPage(self.worker, habits)
        self.mismatch = MismatchPage(self.worker, habits)
        names = ("Start", "Stop", "Pause", "Go on", "Skip rest", "Retreat", "Repeat", "Discard")
        self.readouts = Readouts(self.link, [self.actions_by_name[name] for name in names])
        self.shell = Shell(self.readouts)
        self.setCentralWidget(self.shell)
        self._add_pages()
        self._connect()
        self.keys = KeyFilter(
            running=lambda: self.link.state.running,
            abort=self.link.abort,
            asked=lambda: self._prompt_since,
            answer=self.shell.banner.answer,
        )
        QApplication.instance().installEventFilter(self.keys)  # type: ignore[union-attr]
        self._slow = QTimer(self)
        self._slow.setInterval(_READOUT_MS)
        self._slow.timeout.connect(self._refresh_figures)
        self._slow.start()
        self.take_theme(habits.theme)
        self._restore_layout()
        self.shell.show_page("Live")
        self._show_state(self.link.state)
        # what stands now stands for good: collections of garbage need not look at it again and again
        gc.collect()
        gc.freeze()

    # what can be done

    def connect_rig(self, rig: Path | None) -> None:
        """Open a bench: a rig file, or the simulated one."""
        if self.link.state.running:
            self.say("a run is in progress: stop it before another rig is opened", "note")
            return
        self.rig = rig
        self.habits.rig = rig
        try:
            settings = load_rig(rig_for_the_window(rig))
        except BadInputError as error:
            self.say(str(error), "bad")
            return
        for page in self.shell.pages.values():
            take = getattr(page, "set_rig", None)
            if take is not None:
                take(settings)
        self.link.open(rig)

    def choose_rig(self) -> None:
        """Ask for a rig file."""
        start = self.habits.folder("rigs")
        ask_file(self, "Rig file", start, "Rig files (*.toml)", self._rig_chosen)

    def run_protocol(self, protocol: Path) -> None:
        """Show a protocol on the study page, from where it is started."""
        if self.link.state.running:
            self.say(
                "a run is in progress: let it end, or stop it, before another protocol is loaded", "note"
            )
            return
        if self.study.load(protocol):
            self.shell.show_page("Study")
            self.say(f"{protocol.name} is loaded: F5 starts it", "good")

    def start(self) -> None:
        """Start the study that is shown, or go on with it; asks first where a calibration is old."""
        if not self.link.state.ready:
            self.say(f"start: {self.link.state.words}", "note")
            return
        if self.study.protocol is None or self.study.out is None:
            self.shell.show_page("Study")
            self.say("start: choose a protocol first", "note")
            return
        bench = self.link.state.snapshot.bench
        told = "" if bench is None or bench.simulated else reminder(bench.calibrations)
        if told:
            self._ask(
                self,
                "Calibration",
                f"{told}\n\nRun on these constants?",
                {
                    "Calibrate first": partial(self.shell.show_page, "Calibrate"),
                    "Run on these": self._start,
                },
            )
        else:
            self._start()

    def stop(self) -> None:
        """End the run, after a question: a study is seldom ended on purpose."""
        if not self.link.state.running:
            self.say("stop: nothing runs", "note")
            return
        choices: Choices = {"Go on": lambda: None, "Stop the run": partial(self.link.ask, "stop")}
        self._ask(self, "Stop the run", "The run ends; it can be gone on with later. Stop it?", choices)

    def discard(self, path: Path, reason: str) -> None:
        """Mark a trial as discarded: by the bench, where it runs in that folder, else here."""
        state = self.link.state
        if state.running and Path(state.snapshot.out) == path.parent:
            self.link.ask("discard", file=path.name, reason=reason)
        else:
            self.worker.ask(f"discarding {path.name}", discard, [str(path)], reason, then=self._marked)
        self.say(f"{path.name}: discarded ({reason}); Keep after all takes it back", "note")

    def restore(self, path: Path) -> None:
        """Take back that a trial was discarded."""
        state = self.link.state
        if state.running and Path(state.snapshot.out) == path.parent:
            self.link.ask("restore", file=path.name)
        else:
            self.worker.ask(f"keeping {path.name}", take_back, [str(path)], then=self._marked)
        self.say(f"{path.name}: kept after all", "note")

    def repeat(self, trial: str) -> None:
        """Have a trial of the plan recorded again: next, or, where nothing runs, when it is gone on with."""
        if self.link.state.running:
            self.link.ask("repeat", trial=trial)
        else:
            self.say("repeat: discard the trial and press Start: it is recorded again", "note")

    def take_theme(self, name: str) -> None:
        """Take a look: "light" or "dark"."""
        theme = THEMES.get(name, THEMES["light"])
        self.habits.theme = theme.name
        apply_theme(QApplication.instance(), theme)  # type: ignore[arg-type]
        self.shell.restyle(theme)
        for page in self.shell.pages.values():
            page.restyle(theme)  # type: ignore[attr-defined]

    def say(self, line: str, kind: str = "") -> None:
        """Write a line to the log, its file, and the status line."""
        self.log.add(line, kind)
        self.shell.tell(line, kind)

    def show_keys(self) -> None:
        """List every key, from the actions themselves."""
        lines = ["Esc: ABORT, the arm leaves the skin (any page, while a run is in progress)"]
        lines += ["Enter: answer the bench's question (outside fields)"]
        for action in [*self.actions_by_name.values(), *self.live.actions_here]:
            keys = " or ".join(key.toString() for key in action.shortcuts())
            if keys:
                lines.append(f"{keys}: {action.toolTip() or action.text()}")
        self._ask(self, "Keys", "\n".join(lines), {"Close": lambda: None})

    def reset_layout(self) -> None:
        """Put everything where it was on the first day."""
        self.habits.forget_layouts()
        for splitter in self.shell.splitters().values():
            splitter.setSizes([3 * splitter.width() // 5, 2 * splitter.width() // 5])
        self.resize(1366, 728)

    # Qt's own calls

    def closeEvent(self, event: QCloseEvent) -> None:  # noqa: N802
        """Close; while a run goes on, only after a question."""
        if self.link.state.running and not self._may_close:
            event.ignore()
            choices: Choices = {"Stay": lambda: None, "Stop the run and close": self._close_anyway}
            self._ask(self, "Close", "A run is in progress. Closing stops it; its trials are kept.", choices)
            return
        self._keep_layout()
        self.shell.header.disk.close()
        QApplication.instance().removeEventFilter(self.keys)  # type: ignore[union-attr]
        self._slow.stop()
        self.hide()
        if not self.link.close():
            self.log.add("the rig's program has not ended; its guard acts by itself", "bad")
        self.worker.close()
        self.log.close_file()
        event.accept()

    # what comes in

    def _show_state(self, state: BenchState) -> None:
        self.shell.header.show_state(state)
        if self.shell.banner.show_state(state):
            self._prompt_since = time.monotonic()
            QApplication.beep()
        elif not self.shell.banner.stands:
            self._prompt_since = None
        self.readouts.show_state(state)
        for page in (self.live, self.study, self.calibration):
            page.show_state(state)
        enabled = {
            "Start": state.ready,
            "Stop": state.running,
            "Pause": state.running and not state.snapshot.pausing,
            "Go on": state.running and state.snapshot.pausing,
            "Skip rest": state.running and state.snapshot.rest_left_s > 0,
            "Retreat": state.running,
        }
        for name, on in enabled.items():
            self.actions_by_name[name].setEnabled(on)

    def _frame(self) -> None:
        if self.shell.page == "Live" and self.isVisible():
            self.live.refresh()

    def _refresh_figures(self) -> None:
        self.readouts.refresh()
        self.shell.header.refresh()

    def _marked(self, _: Any) -> None:
        self.study.refresh()
        self.trials.refresh()

    def _calibration_decided(self, keep: bool) -> None:
        self.link.ask("accept", keep=keep)
        if keep:
            # the constants belong to the open bench: it is opened anew with the ones just measured
            QTimer.singleShot(1000, self._reopen)

    def _reopen(self) -> None:
        shown = self.link.state.snapshot.calibration
        if shown is not None and shown.decision == "kept" and not self.link.state.running:
            self.say("the rig is opened again, with the new calibration", "")
            self.connect_rig(self.rig)

    def _start(self) -> None:
        assert self.study.protocol is not None
        assert self.study.out is not None
        simulated = self.link.state.simulated
        hands = "bench" if simulated and self.study.by_bench.isChecked() else "person"
        self._check_room()
        self.link.ask("run", protocol=str(self.study.protocol), out=str(self.study.out), hands=hands)

    def _check_room(self) -> None:
        plan, out = self.study.plan, self.study.out
        free_gb = self.shell.header.disk.free_gb
        if plan is None or out is None or free_gb is None:
            return
        recorded_s = sum(trial.expected_s for trial in plan.trials)
        needed_gb = recorded_s * 8000 * 3 * 8 / 1e9
        if needed_gb > free_gb:
            self.say(f"the study may need {needed_gb:.1f} GB, {free_gb:.1f} GB are free on its disk", "bad")

    def _rig_chosen(self, path: Path) -> None:
        self.habits.used_folder("rigs", path.parent)
        self.connect_rig(path)

    def _make_actions(self) -> dict[str, QAction]:
        return make_actions(
            self,
            {
                "Start": self.start,
                "Stop": self.stop,
                "Pause": partial(self.link.ask, "pause"),
                "Go on": partial(self.link.ask, "go_on"),
                "Skip rest": partial(self.link.ask, "skip", what="rest"),
                "Retreat": partial(self.link.ask, "retreat"),
                "Repeat": self._ask_repeat,
                "Discard": self._ask_discard,
                "Open rig ...": self.choose_rig,
                "Simulated rig": partial(self.connect_rig, None),
                "Light or dark": lambda: self.take_theme("light" if self.habits.theme == "dark" else "dark"),
                "Reset layout": self.reset_layout,
                "Keys": self.show_keys,
                "Quit": self.close,
            },
        )

    def _add_pages(self) -> None:
        for name, page, tip, beside in (
            ("Live", self.live, "position and force as they come", True),
            ("Protocol", self.protocol, "what a run is to do, and what the arm will do", False),
            ("Study", self.study, "what is recorded, and how good it is", True),
            ("Calibrate", self.calibration, "measure the constants of position and force", True),
            ("Trials", self.trials, "browse, overlay, fit and export trials", False),
            ("Mismatch", self.mismatch, "simulation beside recording, and what explains the rest", False),
            ("Log", self.log, "everything that was asked, done and said", False),
        ):
            self.shell.add(name, page, tip, beside=beside)
        self.actions_by_name |= page_actions(self, list(self.shell.pages), self.shell.show_page)

    def _connect(self) -> None:
        self.link.changed.connect(self._show_state)
        self.link.frame.connect(self._frame)
        self.link.said.connect(self.say)
        self.shell.header.abort.connect(self.link.abort)
        self.shell.banner.answered.connect(self._answer)
        self.readouts.volts_wanted.connect(self.live.plot.show_volts)
        self.worker.said.connect(self.say)
        for page in (self.study, self.trials, self.protocol, self.mismatch):
            page.said.connect(self.say)
        self.protocol.run_asked.connect(self.run_protocol)
        self.mismatch.run_asked.connect(self.run_protocol)
        self.mismatch.twin_asked.connect(self.connect_rig)
        self.study.discard_asked.connect(self.discard)
        self.study.restore_asked.connect(self.restore)
        self.study.repeat_asked.connect(self.repeat)
        self.calibration.start_asked.connect(
            lambda kind, hands: self.link.ask("calibrate", which=kind, hands=hands)
        )
        self.calibration.accept_asked.connect(self._calibration_decided)

    def _answer(self, prompt: str, answer: str, value: float | None) -> None:
        self._prompt_since = None
        self.link.ask("answer", prompt=prompt, answer=answer, value=value)

    def _ask_repeat(self) -> None:
        self.study.repeat()

    def _ask_discard(self) -> None:
        self.shell.show_page("Study")
        self.study.discard()

    def _keep_layout(self) -> None:
        self.habits.keep_layout("window", bytes(self.saveGeometry().data()))
        for name, splitter in self.shell.splitters().items():
            self.habits.keep_layout(name, bytes(splitter.saveState().data()))

    def _restore_layout(self) -> None:
        self.resize(1366, 728)
        kept = self.habits.layout("window")
        if kept is not None:
            self.restoreGeometry(QByteArray(kept))
        for name, splitter in self.shell.splitters().items():
            restored(splitter, self.habits.layout(name))

    def _close_anyway(self) -> None:
        self._may_close = True
        self.close()
