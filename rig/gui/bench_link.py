"""The window's link to the bench: one timer that pulls, requests that go out, and what the bench says to them."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Qt, QTimer, Signal

from rig.engine.progress import Snapshot
from rig.engine.ring import Mark
from rig.engine.states import State
from rig.gui.bench_state import AT_REST, BenchState
from rig.gui.bins import Bins
from rig.gui.news import news
from rig.gui.runner_process import START_S, RunnerProcess
from rig.gui.simulated import rig_for_the_window
from rig.hardware.processes import runs

FRAME_MS = 33
_SLOW_S = 0.025
"""After a frame above this the next one is left out, so that the event loop breathes."""

_UNANSWERED_S = 3.0

_LOST_SILENT_S = 4.0

_LETS_GO_S = 20.0
"""A bench that is let go has so long to end before the next one is started."""

_OBEYS_S = 2.0
"""A bench that has not begun to take the arm off the skin so long after an abort is ended: its guard then acts."""


class BenchLink(QObject):
    """Pulls 30 times a second what the bench shows: samples into `bins`, snapshots into `state`.

    `changed` comes when the state has, `frame` at every turn of the timer, `said` with a line for the log
    (and its kind: "", "good", "note", "bad", or "done" for what an abort did), `opened` once a bench answers,
    `doubted` with the words of what a run that was asked for needs to be told first.
    """

    changed = Signal(object)
    frame = Signal()
    said = Signal(str, str)
    opened = Signal()
    doubted = Signal(str)

    def __init__(self, log: Path, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.state = BenchState()
        self.bins: Bins | None = None
        self.marks: list[Mark] = []
        self.log = log
        self._process: RunnerProcess | None = None
        self._left: list[RunnerProcess] = []
        self._asked: dict[str, tuple[str, float]] = {}
        self._aborted_at: float | None = None
        self._opening: Path | None = None
        self._opening_since = 0.0
        self._skip = False
        self._timer = QTimer(self)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.setInterval(FRAME_MS)
        self._timer.timeout.connect(self._turn)
        self._timer.start()

    @property
    def process(self) -> RunnerProcess | None:
        """The bench's process."""
        return self._process

    def open(self, rig: Path | None) -> None:
        """Start a bench; the one before is let go, and ends by itself."""
        self.let_go()
        path = rig_for_the_window(rig)
        name = "simulated rig" if rig is None else rig.name
        self._opening_since = time.monotonic()
        self._opening = path
        self.bins, self._aborted_at = None, None
        self.said.emit(f"connecting to {name} ({path})", "")
        self._tell(BenchState(link="opening", rig=name))
        self._start_when_free()

    def _start_when_free(self) -> None:
        """Start the bench that is to be opened, once the one before has let go of the rig."""
        path = self._opening
        waited_s = time.monotonic() - self._opening_since
        if path is None or (self._left and waited_s < _LETS_GO_S):
            return
        self._opening = None
        try:
            self._process = RunnerProcess(path, self.log)
        except OSError as error:
            self._tell(BenchState(link="died", rig=self.state.rig, trouble=f"{error}"))
            self.said.emit(f"the rig's program could not be started: {error}", "bad")

    def let_go(self) -> None:
        """Let the bench end: what runs is stopped, the arm taken clear."""
        if self._process is not None:
            self._process.let_go()
            self._process.forget()
            self._left.append(self._process)
            self._process = None
        self._opening = None
        self._asked.clear()
        self._tell(BenchState())

    def close(self, patience_s: float = 20.0) -> bool:
        """Let go and wait until every bench has ended; False where one has not."""
        self._timer.stop()
        if self._process is not None:
            self._left.append(self._process)
            self._process = None
        codes = [process.close(patience_s) for process in self._left]
        self._left.clear()
        return all(code is not None for code in codes)

    def ask(self, do: str, **more: Any) -> None:
        """Send a request; what the bench says to it comes by `said`."""
        if self._process is None or self._process.follower is None:
            self.said.emit(f"{do}: no rig is connected", "bad")
            return
        request_id = self._process.ask(do, **more)
        self._asked[request_id] = (do, time.monotonic())
        self.said.emit(_asked_words(do, more), "")
        self._tell(replace(self.state, asked=self.state.asked | {do}))

    def abort(self) -> None:
        """Have the arm moved clear of the skin now, whatever else goes on; sent before anything is painted."""
        if self._process is None or self._process.follower is None:
            self.said.emit("abort: no rig is connected, nothing moves", "note")
            return
        request_id = self._process.ask("stop")
        if self._aborted_at is not None:
            return  # pressed again: sent again, and said once
        self._asked[request_id] = ("abort", time.monotonic())
        if self.state.running:
            self._aborted_at = time.monotonic()
            doing = self.state.snapshot.state
            self.said.emit(f"ABORT asked while {doing}: the arm is to leave the skin", "bad")
        else:
            self.said.emit("abort: nothing runs, the arm rests at its safe position", "note")
        self._tell(replace(self.state, asked=self.state.asked | {"abort"}))

    def volts(self, start: int) -> tuple[int, Any] | None:
        """Return single samples from `start` on, as far back as the last minute; None without a bench."""
        process = self._process
        return process.follower.ring.since(start) if process is not None and process.follower else None

    def _turn(self) -> None:
        began = time.monotonic()
        self._reap()
        self._start_when_free()
        process = self._process
        if process is not None:
            snapshot = process.poll()
            if process.exit_code is not None:
                self._died(process)
            else:
                self._pull(process)
                if snapshot is not None:
                    self._heard(snapshot)
                self._watch(process)
        if self._skip:
            self._skip = False
            return
        self.frame.emit()
        self._skip = time.monotonic() - began > _SLOW_S

    def _pull(self, process: RunnerProcess) -> None:
        if process.follower is None:
            if time.monotonic() - self._opening_since > START_S:
                self._opening_since = time.monotonic()
                self.said.emit("the rig has not answered for a minute; see the log", "bad")
            return
        ring = process.follower.ring
        if self.bins is None:
            self.bins = Bins(ring.sample_rate_hz)
            self.bins.next_sample = ring.written
        self.bins.add(*ring.since(self.bins.next_sample))
        self.marks = ring.marks()

    def _heard(self, snapshot: Snapshot) -> None:
        before = self.state
        for verdict in snapshot.answered:
            asked = self._asked.pop(verdict.id, None)
            if asked is not None and not verdict.accepted:
                self.said.emit(f"{asked[0].replace('_', ' ')}: refused: {verdict.why}", "note")
        state = replace(
            before,
            link="open",
            snapshot=snapshot,
            asked=frozenset(do for do, _ in self._asked.values()),
            trouble="",
        )
        self._tell(state)
        if before.link == "opening":
            self.said.emit(f"connected: {before.rig}", "good")
            self.opened.emit()
        self._tell_changes(before.snapshot, snapshot)

    def _tell_changes(self, before: Snapshot, now: Snapshot) -> None:
        """Say in the log what has become different."""
        if now.state is not before.state:
            self._tell_state(now)
        for line, kind in news(before, now):
            self.said.emit(line, kind)
        if now.doubt is not None and now.doubt != before.doubt:
            self.doubted.emit(now.doubt.words)

    def _tell_state(self, now: Snapshot) -> None:
        if self._aborted_at is not None and now.state in AT_REST | {State.LEAVING}:
            took_ms = 1e3 * (time.monotonic() - self._aborted_at)
            if now.state is State.LEAVING:
                self.said.emit(f"abort: the arm is leaving the skin ({took_ms:.0f} ms after the key)", "note")
            else:
                self._aborted_at = None
                cut = [ended.file for ended in now.ended[-1:] if ended.outcome == "cut short"]
                kept = f"{cut[0]} is kept as aborted" if any(cut) else "no trial was being recorded"
                self.said.emit(
                    f"abort: done, the arm rests at the safe position; {kept} ({took_ms:.0f} ms)", "done"
                )
        elif now.state in {State.FINISHED, State.STOPPED, State.FAILED}:
            self.said.emit(f"{now.title}: {now.state} {now.message}".rstrip(), "")

    def _watch(self, process: RunnerProcess) -> None:
        """Say so where the bench, or a request, is not answered."""
        if self.state.link == "open" and process.silent_s > _LOST_SILENT_S:
            self._tell(replace(self.state, link="silent", trouble="the rig's program does not answer"))
            self.said.emit("the rig's program does not answer; its guard acts by itself", "bad")
        now = time.monotonic()
        if self._aborted_at is not None and now - self._aborted_at > _OBEYS_S:
            if self.state.running and self.state.snapshot.state is not State.LEAVING:
                self.said.emit(
                    "the rig's program does not obey: it is ended, its guard takes the arm clear", "bad"
                )
                process.end_frozen()
            self._aborted_at = None
        for request_id, (do, asked_at) in list(self._asked.items()):
            if now - asked_at > _UNANSWERED_S:
                del self._asked[request_id]
                self.said.emit(f"{do}: the rig has not answered", "bad")
                self._tell(replace(self.state, asked=self.state.asked - {do}))

    def _died(self, process: RunnerProcess) -> None:
        why = process.last_words()
        was = self.state
        process.let_go()
        process.forget()
        self._process = None
        self._asked.clear()
        doing = f" while {was.snapshot.state}" if was.running else ""
        said = f"the rig's program has ended{doing}: {why}"
        if was.link == "opening":
            said = f"{was.rig} could not be opened: {why}"
        self._tell(
            BenchState(link="died", rig=was.rig, snapshot=replace(was.snapshot, prompt=None), trouble=said)
        )
        self.said.emit(said, "bad")
        if was.running:
            facts = was.snapshot.bench
            if facts is not None and any(runs(pid) for pid in facts.guards):
                arm = "the guard takes the arm clear"
            else:
                arm = "NO GUARD IS LEFT: LIFT THE ARM BY HAND, then run `indenter safe`"
            kept = f"; {was.snapshot.file} is kept: `indenter rescue` brings it back"
            self.said.emit(f"{arm}{kept if was.snapshot.file else ''}", "bad")

    def _reap(self) -> None:
        for process in list(self._left):
            if process.exit_code is not None:
                self._left.remove(process)

    def _tell(self, state: BenchState) -> None:
        if state != self.state:
            self.state = state
            self.changed.emit(state)


def _asked_words(do: str, more: Mapping[str, Any]) -> str:
    """Return what was asked for, for the log."""
    told = [f"{value}" for key, value in more.items() if key not in {"prompt", "do"} and value is not None]
    return f"asked: {do.replace('_', ' ')} {', '.join(told)}".strip()
