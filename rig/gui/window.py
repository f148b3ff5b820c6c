"""The bench window: pages around one link to the bench, and everything that may be asked of it."""

from __future__ import annotations

import gc
import time
from functools import partial
from pathlib import Path

from PySide6.QtCore import QByteArray, QTimer
from PySide6.QtGui import QAction, QCloseEvent
from PySide6.QtWidgets import QApplication, QMainWindow

from analysis.errors import BadInputError
from rig.engine.progress import CalibrationShown
from rig.gui.actions import make_actions, page_actions
from rig.gui.asking import ask_file
from rig.gui.bench_link import BenchLink
from rig.gui.bench_state import BenchState
from rig.gui.habits import Habits
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
from rig.gui.running import StudyCommands
from rig.gui.shell import Shell, restored
from rig.gui.simulated import rig_for_the_window
from rig.gui.theme import THEMES, apply_theme
from rig.gui.worker import Worker
from rig.settings.reading import load_rig

_READOUT_MS = 100
_BESIDE_THE_PLOTS = ("Start", "Stop", "Pause", "Go on", "Skip rest", "Retreat", "Repeat", "Discard")


class Window(QMainWindow):
    """One window, one bench, one worker. ``question`` asks the person; tests answer in its place."""

    def __init__(self, habits: Habits, logs: Path, question: Ask = ask) -> None:
        super().__init__()
        # first: what is built measures its columns in the letters of the look
        apply_theme(QApplication.instance(), THEMES.get(habits.theme, THEMES["light"]))  # type: ignore[arg-type]
        self.setWindowTitle("indenter")
        self.habits, self._ask = habits, question
        self.rig: Path | None = None
        self.worker = Worker(self)
        self.link = BenchLink(logs / "bench.log", self)
        self._prompt_since: float | None = None
        self._may_close = False
        self._calibration: CalibrationShown | None = None
        self.live, self.log = LivePage(self.link), LogPage(logs / "window.log")
        self.study = StudyPage(self.worker, habits)
        self.calibration = CalibrationPage()
        self.trials = TrialsPage(self.worker, habits)
        self.protocol = ProtocolPage(self.worker, habits)
        self.mismatch = MismatchPage(self.worker, habits)
        self.readouts = Readouts(self.link)
        self.shell = Shell(self.readouts)
        self.setCentralWidget(self.shell)
        self.commands = StudyCommands(
            self.link, self.study, self.trials, self.shell, self.worker, question, self.say
        )
        self.actions_by_name = self._make_actions()
        self.readouts.offer([self.actions_by_name[name] for name in _BESIDE_THE_PLOTS])
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
        try:
            settings = load_rig(rig_for_the_window(rig))
        except BadInputError as error:
            open_still = self.link.state.link in {"open", "silent"}
            self.say(f"{error}{f'; {self.link.state.rig} stays connected' if open_still else ''}", "bad")
            return
        self.rig = rig
        self.habits.rig = rig
        for page in self.shell.pages.values():
            take = getattr(page, "set_rig", None)
            if take is not None:
                take(settings)
        self.link.open(rig)

    def choose_rig(self) -> None:
        """Ask for a rig file."""
        start = self.habits.folder("rigs")
        ask_file(self, "Rig file", start, "Rig files (*.toml)", self._rig_chosen)

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

    def close_now(self) -> None:
        """Close without a question: what runs is stopped, the arm taken clear. Done once."""
        self._may_close = True
        if self.isVisible():
            self.close()

    # Qt's own calls

    def closeEvent(self, event: QCloseEvent) -> None:  # noqa: N802
        """Close; while a run goes on, only after a question."""
        if self.link.state.running and not self._may_close:
            event.ignore()
            choices: Choices = {"Stay": lambda: None, "Stop the run and close": self.close_now}
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
        self._take_calibration(state)
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

    def _take_calibration(self, state: BenchState) -> None:
        """Open the bench anew once a calibration is kept: its constants belong to the open bench."""
        shown, last = state.snapshot.calibration, self._calibration
        self._calibration = shown
        if shown is not None and shown.decision == "kept" and last is not None and last.decision != "kept":
            self.say("the rig is opened again, with the new calibration", "")
            QTimer.singleShot(0, partial(self.connect_rig, self.rig))  # after this state has been shown

    def _rig_chosen(self, path: Path) -> None:
        self.habits.used_folder("rigs", path.parent)
        self.connect_rig(path)

    def _make_actions(self) -> dict[str, QAction]:
        return make_actions(
            self,
            {
                "Start": self.commands.start,
                "Stop": self.commands.stop,
                "Pause": partial(self.link.ask, "pause"),
                "Go on": partial(self.link.ask, "go_on"),
                "Skip rest": partial(self.link.ask, "skip", what="rest"),
                "Retreat": partial(self.link.ask, "retreat"),
                "Repeat": self.study.repeat,
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
        for failed in (self.worker.said, self.study.failed):
            failed.connect(partial(self.say, kind="bad"))
        for page in (self.study, self.trials, self.protocol, self.mismatch):
            page.said.connect(self.say)
        self.protocol.run_asked.connect(self.commands.run_protocol)
        self.mismatch.run_asked.connect(self.commands.run_protocol)
        self.mismatch.twin_asked.connect(self.connect_rig)
        self.calibration.start_asked.connect(
            lambda kind, hands: self.link.ask("calibrate", which=kind, hands=hands)
        )
        self.calibration.accept_asked.connect(lambda keep: self.link.ask("accept", keep=keep))

    def _answer(self, prompt: str, answer: str, value: float | None) -> None:
        self._prompt_since = None
        self.link.ask("answer", prompt=prompt, answer=answer, value=value)

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
