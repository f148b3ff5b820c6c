"""What the window does about a study: loads, starts and stops it, discards, takes back and repeats its trials."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from rig.gui.bench_link import BenchLink
from rig.gui.calibration_words import reminder
from rig.gui.jobs.marking import discard, take_back
from rig.gui.pages.study import StudyPage
from rig.gui.pages.trials import TrialsPage
from rig.gui.questions import Ask, Choices
from rig.gui.shell import Shell
from rig.gui.worker import Worker

_BYTES_A_SAMPLE = 24


class StudyCommands:
    """Asks the bench where a run goes on, and does it here where none does."""

    def __init__(
        self,
        link: BenchLink,
        study: StudyPage,
        trials: TrialsPage,
        shell: Shell,
        worker: Worker,
        question: Ask,
        say: Callable[..., None],
    ) -> None:
        self._link, self._study, self._trials = link, study, trials
        self._shell, self._worker, self._ask, self._say = shell, worker, question, say
        self._run: dict[str, str] = {}
        study.discard_asked.connect(self.discard)
        study.restore_asked.connect(self.restore)
        study.repeat_asked.connect(self.repeat)
        link.doubted.connect(self._doubted)

    def run_protocol(self, protocol: Path) -> None:
        """Show a protocol on the study page, from where it is started."""
        if self._link.state.running:
            self._say(
                "a run is in progress: let it end, or stop it, before another protocol is loaded", "note"
            )
            return
        if self._study.load(protocol):
            self._shell.show_page("Study")
            self._say(f"{protocol.name} is loaded: F5 starts it", "good")

    def start(self) -> None:
        """Start the study that is shown, or go on with it; asks first where a calibration is old."""
        if not self._link.state.ready:
            self._say(f"start: {self._link.state.words}", "note")
            return
        if self._study.protocol is None or self._study.out is None:
            self._shell.show_page("Study")
            self._say("start: choose a protocol first", "note")
            return
        bench = self._link.state.snapshot.bench
        told = "" if bench is None else reminder(bench.calibrations, simulated=bench.simulated)
        if told:
            self._ask(
                self._shell,
                "Calibration",
                f"{told}\n\nRun on these constants?",
                {
                    "Calibrate first": partial(self._shell.show_page, "Calibrate"),
                    "Run on these": self._start,
                },
            )
        else:
            self._start()

    def stop(self) -> None:
        """End the run, after a question: a study is seldom ended on purpose."""
        if not self._link.state.running:
            self._say("stop: nothing runs", "note")
            return
        choices: Choices = {"Go on": lambda: None, "Stop the run": partial(self._link.ask, "stop")}
        self._ask(
            self._shell, "Stop the run", "The run ends; it can be gone on with later. Stop it?", choices
        )

    def discard(self, path: Path, reason: str) -> None:
        """Mark a trial as discarded: by the bench, where it runs in that folder, else here."""
        state = self._link.state
        if state.running and Path(state.snapshot.out) == path.parent:
            self._link.ask("discard", file=path.name, reason=reason)
        else:
            self._worker.ask(f"discarding {path.name}", discard, [str(path)], reason, then=self._marked)
        self._say(f"{path.name}: discarded ({reason}); Keep after all takes it back", "note")

    def restore(self, path: Path) -> None:
        """Take back that a trial was discarded."""
        state = self._link.state
        if state.running and Path(state.snapshot.out) == path.parent:
            self._link.ask("restore", file=path.name)
        else:
            self._worker.ask(f"keeping {path.name}", take_back, [str(path)], then=self._marked)
        self._say(f"{path.name}: kept after all", "note")

    def repeat(self, trial: str) -> None:
        """Have a trial of the plan recorded again: next, or, where nothing runs, when it is gone on with."""
        if self._link.state.running:
            self._link.ask("repeat", trial=trial)
        else:
            self._say("repeat: discard the trial and press Start: it is recorded again", "note")

    def _start(self) -> None:
        assert self._study.protocol is not None
        assert self._study.out is not None
        simulated = self._link.state.simulated
        hands = "bench" if simulated and self._study.by_bench.isChecked() else "person"
        self._check_room()
        self._run = {"protocol": str(self._study.protocol), "out": str(self._study.out), "hands": hands}
        self._link.ask("run", **self._run)

    def _doubted(self, words: str) -> None:
        """Ask whether the run is to begin all the same: its trials were recorded with another calibration."""
        choices: Choices = {
            "Don't start": lambda: self._say("not started: nothing was changed", "note"),
            "Go on with this one": partial(self._link.ask, "run", **self._run, accept=True),
        }
        self._ask(self._shell, "Another calibration", words, choices)

    def _check_room(self) -> None:
        plan, out = self._study.plan, self._study.out
        free_gb = self._shell.header.disk.free_gb
        if plan is None or out is None or free_gb is None:
            return
        recorded_s = sum(trial.expected_s for trial in plan.trials)
        needed_gb = recorded_s * 8000 * _BYTES_A_SAMPLE / 1e9
        if needed_gb > free_gb:
            self._say(f"the study may need {needed_gb:.1f} GB, {free_gb:.1f} GB are free on its disk", "bad")

    def _marked(self, _: Any) -> None:
        self._study.refresh()
        self._trials.refresh()
