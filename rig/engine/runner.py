"""The runner: takes a plan through its states, trial by trial, and leaves the arm clear of the skin."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from analysis.recordings import TrialHeader, TrialWriter
from analysis.recordings.trial import Specimen
from rig.engine.bench import Bench
from rig.engine.filing import Filing, TrialFile
from rig.engine.interrupts import Interrupts
from rig.engine.motions import TrialMotions
from rig.engine.positioning import move_to
from rig.engine.preparing import Preparations, Prepared
from rig.engine.progress import Countdown, Snapshot
from rig.engine.recorder import Recorder
from rig.engine.states import State, StateMachine
from rig.hardware.errors import RetreatFailedError
from rig.hardware.lever import Chunk
from rig.protocols.steps import Approach, Plan, PlannedTrial, Sweep

_SHOW_EVERY_S = 0.25
"""While samples come, progress is shown no more often than this, s of the wall clock."""

_ROOM_S = 30.0
"""Room reserved in a file beyond the longest that the trial's motions can take: pauses of a busy computer, s.

All of it is reserved before the arm moves, since nothing may be rewritten while the punch is in the skin."""

_FREE_WAY_MN = 10.0
"""Force that stops a move where only air is expected and the approach says nothing better."""


class Observer(Protocol):
    """Sees a run and can't hold it up: the feed, a progress bar, a test."""

    def show(self, snapshot: Snapshot) -> None:
        """See what the run does now."""
        ...

    def follow(self, chunk: Chunk) -> None:
        """See samples as they come."""
        ...


@dataclass(frozen=True, slots=True)
class Task:
    """A planned trial and the file it goes to."""

    trial: PlannedTrial
    path: Path


@dataclass(frozen=True, slots=True)
class Recorded:
    """A trial that was recorded to its end; `mass_g` is what hung from the arm, where a weight did."""

    task: Task
    mass_g: float | None


class Runner:
    """Runs tasks on a bench, as the only thing that acts.

    Whatever happens in a trial, the arm is taken to the safe position before anything else, and the file
    is closed with how it ended.
    """

    def __init__(self, bench: Bench, interrupts: Interrupts, observers: Sequence[Observer] = ()) -> None:
        self._bench = bench
        self._interrupts = interrupts
        self._observers = observers
        self._machine = StateMachine()
        self._snapshot = Snapshot(title="", state=State.IDLE)
        self._countdown = Countdown(())
        self._shown_at = 0.0
        self._contact_mm: float | None = None
        self._preparations = Preparations(
            bench, interrupts, enter=self._enter, spend=self._spend, say=self._say
        )

    def run(self, plan: Plan, tasks: Sequence[Task], out: Path) -> list[Recorded]:
        """Run the tasks in order, then the plan's closing steps.

        Raises Interrupted after a clean stop, RigError where a trial failed; the trial's file is kept,
        marked as aborted.
        """
        self._countdown = Countdown([task.trial for task in tasks])
        self._snapshot = replace(self._snapshot, title=plan.title, n_trials=len(tasks), out=str(out))
        recorded: list[Recorded] = []
        try:
            # a run before this one may have left the arm anywhere, and hands come under it now
            with self._interrupts.shielded():
                self._bench.lever.retreat()
                self._bench.lever.prove()
            for number, task in enumerate(tasks, start=1):
                self._snapshot = replace(self._snapshot, trial=task.trial.name, trial_number=number)
                recorded.append(self._run_trial(task))
                self._countdown.next_trial()
                self._enter(State.SAVED)
            self._preparations.do(plan.closing)
        except BaseException as error:
            self._leave()
            self._say(" ".join(str(error).split()))
            self._enter(State.STOPPED if isinstance(error, KeyboardInterrupt) else State.FAILED)
            raise
        self._say("")
        self._enter(State.FINISHED)
        return recorded

    def _run_trial(self, task: Task) -> Recorded:
        trial = task.trial
        self._enter(State.PREPARING)
        prepared = self._preparations.do(trial.preparations)
        self._enter(State.POSITIONING)
        self._say("")
        try:
            # the file first: to make room for a long trial takes seconds, in which the arm need not be away
            with TrialFile(self._open(task, prepared)) as writer, Filing(writer) as filing:
                try:
                    self._go_to_start(trial)
                    self._record(trial, writer, filing)
                finally:
                    filing.end()
                    self._leave()
        finally:
            self._leave()
        self._preparations.indentation_ended()
        return Recorded(task, prepared.mass_g)

    def _record(self, trial: PlannedTrial, writer: TrialWriter, filing: Filing) -> None:
        lever = self._bench.lever

        def check() -> None:
            self._interrupts.check()
            filing.check()

        recorder = Recorder(lever, writer, check, self._follow, read_s=self._bench.read_s)
        lever.start_recording(filing.keep)
        motions = TrialMotions(lever, recorder, enter=self._enter, say=self._say)
        n = None
        try:
            for motion in trial.motions:
                motions.do(motion)
            n = recorder.n
        except BaseException:
            recorder.cut_short()
            raise
        finally:
            # of a trial that is cut short, all that was fetched is kept
            filing.end(n, None if lever.loopback_wired else recorder.command_v)
        if motions.surface is not None:
            self._contact_mm = motions.surface.position_mm

    def _leave(self) -> None:
        """The one finaliser: take the arm clear of the skin; does nothing where it has been done."""
        if self._machine.state is State.LEAVING:
            return
        began_with = sys.exception()
        with self._interrupts.shielded():
            self._enter(State.LEAVING)
            try:
                self._bench.lever.retreat()
            except RetreatFailedError as failure:
                if began_with is None or isinstance(began_with, RetreatFailedError):
                    raise
                raise RetreatFailedError(f"{failure}; it began with: {began_with}") from failure
            self._bench.lever.stop_recording()

    def _go_to_start(self, trial: PlannedTrial) -> None:
        """Move through the air to where the first motion begins."""
        lever, first = self._bench.lever, trial.motions[0]
        start_mm, threshold_mn = None, _FREE_WAY_MN
        if isinstance(first, Sweep):
            start_mm = first.from_mm
        elif isinstance(first, Approach):
            start_mm, threshold_mn = first.start_mm, first.threshold_mn
            if first.short_of_previous_mm is not None and self._contact_mm is not None:
                start_mm = self._contact_mm - first.short_of_previous_mm
        if start_mm is not None:
            start_mm = max(start_mm, lever.limits.travel_min_mm)
            move_to(lever, start_mm, threshold_mn, self._interrupts.check)

    def _open(self, task: Task, prepared: Prepared) -> TrialWriter:
        trial, lever = task.trial, self._bench.lever
        header = TrialHeader(
            kind=trial.kind,
            source=self._bench.source,
            sample_rate_hz=lever.sample_rate_hz,
            calibration=lever.calibration,
            protocol=trial.summary,
            specimen=self._specimen(trial),
            log=(f"recorded by indenter as {trial.name} on the rig {self._bench.rig!r}", *prepared.words),
        )
        travel_mm = lever.limits.travel_max_mm - lever.limits.travel_min_mm
        room_s = trial.longest_s(travel_mm) + _ROOM_S
        return TrialWriter(task.path, header, round(room_s * lever.sample_rate_hz), grow=False)

    def _specimen(self, trial: PlannedTrial) -> Specimen:
        """Return the specimen with the rest it has had, where it is tissue and was pressed before."""
        rested_s = self._preparations.rested_s()
        if rested_s is None or trial.kind != "ramp_hold_retract":
            return trial.specimen
        return replace(trial.specimen, rest_s=round(rested_s, 2))

    # what observers see

    def _enter(self, state: State) -> None:
        self._machine.to(state)
        self._show(replace(self._snapshot, state=state))

    def _say(self, message: str) -> None:
        self._show(replace(self._snapshot, message=message))

    def _spend(self, seconds: float) -> None:
        self._countdown.use(seconds)

    def _follow(self, chunk: Chunk) -> None:
        self._countdown.use(chunk.n / self._bench.lever.sample_rate_hz)
        for observer in self._observers:
            observer.follow(chunk)
        if time.monotonic() - self._shown_at > _SHOW_EVERY_S:
            self._show(self._snapshot)

    def _show(self, snapshot: Snapshot) -> None:
        self._snapshot = replace(snapshot, done_s=self._countdown.done_s, left_s=self._countdown.left_s)
        self._shown_at = time.monotonic()
        for observer in self._observers:
            observer.show(self._snapshot)
