"""What a run tells of itself: state, snapshot and countdown in one place, shown to its audience."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from analysis.recordings.trial import Calibration, Surface
from rig.engine.audience import Audience
from rig.engine.control import Control
from rig.engine.progress import Countdown, Snapshot
from rig.engine.states import State, StateMachine
from rig.engine.tasks import Ended, Task
from rig.hardware.lever import Chunk
from rig.protocols.steps import Approach

_SHOW_EVERY_S = 0.25
"""While samples come, progress is shown no more often than this, s of the wall clock."""

_ENDED_KEPT = 64
"""Trials that a snapshot tells of; the folder tells of the others."""


class Telling:
    """Keeps the snapshot of one run and shows it whenever it changes; used by the run's thread."""

    def __init__(
        self, audience: Audience, control: Control, rate_hz: float, snapshot: Snapshot | None
    ) -> None:
        self._audience = audience
        self._control = control
        self._rate_hz = rate_hz
        self._machine = StateMachine()
        self._shown_at = 0.0
        self.snapshot = snapshot or Snapshot(title="", state=State.IDLE)
        self.countdown = Countdown(())

    @property
    def state(self) -> State:
        """What the run is doing."""
        return self._machine.state

    def begin(self, title: str, tasks: tuple[Task, ...], out: Path) -> None:
        """A run begins."""
        self.countdown = Countdown([task.trial for task in tasks])
        self.snapshot = replace(self.snapshot, title=title, n_trials=len(tasks), out=str(out))

    def begin_trial(self, task: Task, number: int, n_trials: int) -> None:
        """A trial is next; what the one before found no longer stands."""
        self.snapshot = replace(
            self.snapshot,
            trial=task.trial.name,
            trial_number=number,
            n_trials=n_trials,
            surface_mm=None,
            overshoot_um=None,
            threshold_mn=None,
            n_samples=0,
        )

    def enter(self, state: State) -> None:
        """Go to a state; RuntimeError where the table of states forbids it."""
        self._machine.to(state)
        self._control.entered(state)
        self.change(state=state)

    def say(self, message: str) -> None:
        """Say something of what is being done."""
        self.change(message=message)

    def spend(self, seconds: float) -> None:
        """Count bench time used."""
        self.countdown.use(seconds)

    def approaches(self, step: Approach, calibration: Calibration) -> None:
        """Show the force, above that of the free arm, at which this approach is to end."""
        volts = step.threshold_v
        threshold_mn = step.threshold_mn if volts is None else volts / abs(calibration.volts_per_mn)
        self.change(threshold_mn=threshold_mn)

    def found(self, surface: Surface | None) -> None:
        """Show where the surface was found."""
        if surface is not None and surface.position_mm != self.snapshot.surface_mm:
            self.change(
                surface_mm=surface.position_mm,
                overshoot_um=surface.overshoot_um,
                threshold_mn=surface.threshold_mn,
            )

    def ended(self, ended: Ended) -> None:
        """Say what became of a trial."""
        self.change(ended=(*self.snapshot.ended, ended)[-_ENDED_KEPT:], file="", prompt=None, rest_left_s=0.0)

    def mark(self, name: str, sample: int, now: int) -> None:
        """Mark a sample of the trial, which is at sample `now`."""
        self._audience.mark(name, sample, now)

    def follow(self, chunk: Chunk) -> None:
        """Show samples, and count those that never came."""
        self.countdown.use(chunk.n / self._rate_hz)
        before = self.snapshot
        lost = max(0, chunk.start - before.n_samples)
        self.snapshot = replace(before, n_samples=chunk.start + chunk.n, n_lost=before.n_lost + lost)
        self._audience.follow(chunk)
        due = time.monotonic() - self._shown_at > _SHOW_EVERY_S
        if due or self._control.pausing() != before.pausing:
            self.change()

    def change(self, **values: Any) -> None:
        """Change fields of the snapshot and show it."""
        self.snapshot = replace(
            self.snapshot,
            done_s=self.countdown.done_s,
            left_s=self.countdown.left_s,
            pausing=self._control.pausing(),
            **values,
        )
        self._shown_at = time.monotonic()
        self._audience.show(self.snapshot, wait=self.state is not State.LEAVING)
