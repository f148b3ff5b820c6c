"""The runner: takes a plan through its states, trial by trial, and leaves the arm clear of the skin."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from analysis.errors import BadInputError
from analysis.recordings import TrialHeader, TrialWriter, mark_discarded
from analysis.recordings.trial import Specimen
from analysis.recordings.writing import take_back_discard
from rig.engine.agenda import Agenda
from rig.engine.attempts import planned_name
from rig.engine.audience import PATIENCE_S, Audience, Observer
from rig.engine.bench import Bench
from rig.engine.control import Control, Skipped
from rig.engine.errors import LEFT_LIKE
from rig.engine.filing import Filing, TrialFile
from rig.engine.idling import Idling, Nothing
from rig.engine.interrupts import CutShort, Interrupts
from rig.engine.motions import TrialMotions
from rig.engine.positioning import move_to
from rig.engine.preparing import Preparations, Prepared
from rig.engine.progress import CalibrationShown, Snapshot
from rig.engine.recorder import Recorder
from rig.engine.requests import Discard
from rig.engine.ring import END, TRIAL
from rig.engine.states import State
from rig.engine.tasks import Ended, Outcome, Recorded, Task
from rig.engine.telling import Telling
from rig.hardware.errors import RetreatFailedError
from rig.protocols.steps import Approach, Plan, PlannedTrial, Sweep

_ROOM_S = 30.0
"""Room reserved in a file beyond the longest that the trial's motions can take: pauses of a busy computer, s.

All of it is reserved before the arm moves, since nothing may be rewritten while the punch is in the skin."""

_FREE_WAY_MN = 10.0
"""Force that stops a move where only air is expected and the approach says nothing better."""


__all__ = ["Observer", "Recorded", "Runner", "Task"]


class Runner:
    """Runs tasks on a bench, as the only thing that acts.

    Whatever happens in a trial, the arm is taken to the safe position before anything else, and the file
    is closed with how it ended. Observers look on and can neither hold it up nor make it fail; `control`
    is what others ask of it; `idle` has its turn while nothing is recorded. `recorded` is told
    of each trial, for a calibration that shows its points as they come.
    """

    def __init__(
        self,
        bench: Bench,
        interrupts: Interrupts,
        observers: Sequence[Observer] = (),
        *,
        control: Control | None = None,
        patience_s: float = PATIENCE_S,
        idle: Idling | None = None,
        recorded: Callable[[Recorded], CalibrationShown | None] = lambda _: None,
        snapshot: Snapshot | None = None,
    ) -> None:
        self._bench = bench
        self._interrupts = interrupts
        interrupts.at_once = bench.lever.flee
        self._control = control or Control(interrupts)
        self._audience = Audience(observers, patience_s)
        self._telling = Telling(self._audience, self._control, bench.lever.sample_rate_hz, snapshot)
        self._idle = idle or Nothing()
        self._tell_recorded = recorded
        self._agenda = Agenda((), Path())
        self._plan = Plan("", ())
        self._contact_mm: float | None = None
        self._preparations = Preparations(
            bench,
            self._control,
            enter=self._telling.enter,
            spend=self._telling.spend,
            say=self._telling.say,
            show_rest=lambda left_s: self._telling.change(rest_left_s=left_s),
            show_prompt=lambda prompt: self._telling.change(prompt=prompt),
            idle=self._between,
        )

    @property
    def snapshot(self) -> Snapshot:
        """What the run has last told of itself."""
        return self._telling.snapshot

    def run(self, plan: Plan, tasks: Sequence[Task], out: Path) -> list[Recorded]:
        """Run the tasks in order, then the plan's closing steps.

        Raises Interrupted after a clean stop, RigError where a trial failed; the trial's file is kept,
        marked as aborted.
        """
        with self._audience:
            return self._run(plan, tuple(tasks), out)

    def _run(self, plan: Plan, tasks: tuple[Task, ...], out: Path) -> list[Recorded]:
        telling = self._telling
        telling.begin(plan.title, tasks, out)
        self._plan, self._agenda = plan, Agenda(tasks, out)
        self._control.begin({trial.name for trial in plan.trials})
        done: list[Recorded] = []
        try:
            # a run before this one may have left the arm anywhere, and hands come under it now
            with self._interrupts.shielded():
                self._bench.lever.retreat()
                self._bench.lever.prove()
            while (task := self._agenda.next()) is not None:
                telling.begin_trial(task, self._agenda.n_begun, self._agenda.n_tasks)
                recorded = self._attempt(task)
                if recorded is not None:
                    done.append(recorded)
                telling.countdown.next_trial()
                self._between()
            self._preparations.do(plan.closing)
        except BaseException as error:
            self._idle.end()
            self._leave()
            said = " ".join(str(error).split())
            stopped = isinstance(error, KeyboardInterrupt)
            fault = "" if stopped else said
            telling.change(error=fault, message=said, prompt=None, rest_left_s=0.0, file="")
            telling.enter(State.STOPPED if stopped else State.FAILED)
            raise
        self._idle.end()
        telling.say("")
        telling.enter(State.FINISHED)
        return done

    def _attempt(self, task: Task) -> Recorded | None:
        """Record a trial; None where the operator left it out, or ended it early."""
        outcome: Outcome = "failed"
        reason, recorded = "", None
        try:
            recorded = self._run_trial(task)
            outcome = "complete"
        except Skipped as left_out:
            outcome, reason = "skipped", str(left_out)
        except CutShort as cut:
            outcome, reason = "cut short", str(cut)
        except KeyboardInterrupt as stopped:
            outcome, reason = "cut short", str(stopped)
            raise
        except BaseException as error:
            reason = " ".join(str(error).split())
            raise
        finally:
            self._interrupts.forget_cut()
            self._telling.ended(Ended.of(task, outcome, reason))
        shown = None if recorded is None else self._tell_recorded(recorded)
        if shown is not None:
            self._telling.change(calibration=shown)
        self._telling.enter(State.PREPARING if outcome == "skipped" else State.SAVED)
        if outcome == "cut short":
            self._preparations.pause()
        return recorded

    def _between(self) -> None:
        """What is done while nothing is recorded: marks on files, trials that are put in again."""
        telling = self._telling
        for errand in self._control.take_errands():
            path = self._agenda.out / errand.file
            try:
                if isinstance(errand, Discard):
                    mark_discarded(path, errand.reason)
                    telling.ended(Ended(planned_name(path.stem), path.name, "discarded", errand.reason))
                else:
                    take_back_discard(path)
                    telling.ended(Ended(planned_name(path.stem), path.name, "complete", "kept after all"))
            except (BadInputError, OSError) as error:
                telling.say(f"{errand.do}: {' '.join(str(error).split())}")
        for name in self._control.take_repeats():
            trial = next(trial for trial in self._plan.trials if trial.name == name)
            self._agenda.repeat(trial)
            telling.countdown.insert(trial)
            telling.change(n_trials=self._agenda.n_tasks)
        self._idle.look()

    def _run_trial(self, task: Task) -> Recorded:
        trial = task.trial
        self._telling.enter(State.PREPARING)
        self._preparations.pause()
        prepared = self._preparations.do(trial.preparations)
        self._preparations.pause()
        self._control.check()
        self._idle.end()
        self._telling.enter(State.POSITIONING)
        self._telling.say("")
        try:
            # the file first: to make room for a long trial takes seconds, in which the arm need not be away
            with TrialFile(self._open(task, prepared)) as writer, Filing(writer) as filing:
                self._telling.change(file=task.path.name)
                try:
                    self._go_to_start(trial)
                    self._record(trial, writer, filing)
                except LEFT_LIKE:
                    self._interrupts.check()  # told to, the arm has left: that is no fault
                    raise
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

        telling = self._telling
        recorder = Recorder(
            lever, writer, filing.note, check, telling.follow, telling.mark, read_s=self._bench.read_s
        )
        lever.start_recording(filing.keep)
        telling.mark(TRIAL, 0, 0)
        motions = TrialMotions(lever, recorder, enter=telling.enter, say=telling.say)
        n = None
        try:
            for motion in trial.motions:
                if isinstance(motion, Approach):
                    telling.approaches(motion, lever.calibration)
                motions.do(motion)
                telling.found(motions.surface)
            n = recorder.n
        except BaseException:
            # of a trial that is cut short, all that was fetched is kept
            filing.end(None, None if lever.loopback_wired else recorder.command_v)
            try:
                self._leave()  # the arm first: what is written of it waits for the disk
            finally:
                recorder.cut_short()
            raise
        finally:
            telling.mark(END, recorder.n, recorder.n)
            filing.end(n, None if lever.loopback_wired else recorder.command_v)
        if motions.surface is not None:
            self._contact_mm = motions.surface.position_mm

    def _leave(self) -> None:
        """The one finaliser: take the arm clear of the skin; does nothing where it has been done."""
        if self._telling.state is State.LEAVING:
            return
        began_with = sys.exception()
        with self._interrupts.shielded():
            self._telling.enter(State.LEAVING)
            try:
                self._bench.lever.retreat()
            except RetreatFailedError as failure:
                if began_with is None or isinstance(began_with, RetreatFailedError):
                    raise
                raise RetreatFailedError(f"{failure}; it began with: {began_with}") from failure
            finally:
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
