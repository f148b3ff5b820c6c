"""Which samples of a trial a fit uses: approach (or what there is of it) to the end of the hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import FloatArray, Phase, Trial

_LEAST_SAMPLES = 20  # of a hold; two terms and a constant have five unknowns


class CannotFitError(ValueError):
    """The reason, in one line, why a trial has no fit; it becomes the flag of the trial's row."""


@dataclass(frozen=True, slots=True)
class FitWindow:
    """The samples from the approach to the end of the hold, in millimetres and millinewtons, each (N,).

    ``time_s`` counts from the first sample of the window. ``even`` says that samples are evenly spaced by
    ``step_s``; otherwise it is their median spacing. ``ramp_start`` and ``hold_start`` index the window;
    the pre-ramp stretch before ``approach_stop`` is where contact is made. ``command_mm`` is None where none
    was recorded; ``surface_mm`` is where the recording itself says that the skin was found, or None.
    """

    time_s: FloatArray
    step_s: float
    even: bool
    position_mm: FloatArray
    force_mn: FloatArray
    command_mm: FloatArray | None
    approach_stop: int
    ramp_start: int
    hold_start: int
    first_sample: int
    surface_mm: float | None

    @property
    def hold_s(self) -> float:
        """Length of the hold, s."""
        return float(self.time_s[-1] - self.time_s[self.hold_start])

    @property
    def ramp_s(self) -> float:
        """Length of the ramp, s."""
        return float(self.time_s[self.hold_start] - self.time_s[self.ramp_start])


def cut_window(trial: Trial) -> FitWindow:
    """Return the samples that a fit uses; CannotFitError says why there are none.

    An import that is unevenly sampled is used as it was taken, not as resampled.
    """
    if trial.kind != "ramp_hold_retract":
        raise CannotFitError(
            f"no relaxation of skin to fit: the trial's kind is {trial.kind.replace('_', ' ')}"
        )
    hold = trial.phase("hold")
    if hold is None:
        instead = next((f" ({event.message})" for event in trial.events if event.kind == "force_held"), "")
        raise CannotFitError(f"no hold to fit: the trial has no phase named hold{instead}")
    return _cut(trial, hold)


def cut_creep(trial: Trial) -> FitWindow | None:
    """Return the samples up to the end of a pause in which force was held, None where no such pause is stated.

    The pause, which an import's event ``force_held`` begins and the next phase ends, stands as the window's hold.
    """
    event = next((event for event in trial.events if event.kind == "force_held"), None)
    if event is None or trial.phase("hold") is not None or trial.kind != "ramp_hold_retract":
        return None
    stop = min((phase.start for phase in trial.phases if phase.start > event.sample), default=trial.n_samples)
    return _cut(trial, Phase("hold", event.sample, stop))


def _cut(trial: Trial, hold: Phase) -> FitWindow:
    earlier = [trial.phase(name) for name in ("approach", "dwell", "ramp")]
    starts = [phase.start for phase in earlier if phase is not None and phase.stop <= hold.start]
    first = min(starts, default=hold.start)
    ramp = trial.phase("ramp")
    ramp_start = ramp.start if ramp is not None and ramp.stop <= hold.start else hold.start
    approach = trial.phase("approach")
    approach_stop = approach.stop if approach is not None and approach.stop <= ramp_start else hold.start
    marks = np.array([first, approach_stop, ramp_start, hold.start, hold.stop])
    window = _native(trial, marks) if trial.native is not None else _even(trial, marks)
    samples = len(window.time_s) - window.hold_start
    if samples < _LEAST_SAMPLES:
        raise CannotFitError(f"hold too short to fit: {samples} samples, {_LEAST_SAMPLES} are needed")
    if not (np.all(np.isfinite(window.force_mn)) and np.all(np.isfinite(window.position_mm))):
        raise CannotFitError("signals or calibration are not finite numbers")
    if np.ptp(window.force_mn) == 0.0:
        raise CannotFitError(f"force never changes: it is {window.force_mn[0]:.4g} mN throughout")
    return window


def _even(trial: Trial, marks: NDArray[np.int64]) -> FitWindow:
    first, approach_stop, ramp_start, hold_start, stop = (int(mark) for mark in marks)
    used = slice(first, stop)
    command_mm = trial.command_mm
    step_s = 1.0 / trial.sample_rate_hz
    return FitWindow(
        time_s=np.arange(stop - first, dtype=float) * step_s,
        step_s=step_s,
        even=True,
        position_mm=trial.position_mm[used],
        force_mn=trial.force_mn[used],
        command_mm=None if command_mm is None else command_mm[used],
        approach_stop=approach_stop - first,
        ramp_start=ramp_start - first,
        hold_start=hold_start - first,
        first_sample=first,
        surface_mm=None if trial.surface is None else trial.surface.position_mm,
    )


def _native(trial: Trial, marks: NDArray[np.int64]) -> FitWindow:
    native = trial.native
    assert native is not None
    instants_s = marks / trial.sample_rate_hz
    instants_s[:-1] -= 1e-9  # a mark on a sample includes it
    first, approach_stop, ramp_start, hold_start, stop = (
        int(i) for i in np.searchsorted(native.time_s, instants_s)
    )
    used = slice(first, stop)
    time_s = native.time_s[used] - (native.time_s[first] if first < len(native.time_s) else 0.0)
    return FitWindow(
        time_s=time_s,
        step_s=float(np.median(np.diff(time_s))) if len(time_s) > 1 else 1.0 / trial.sample_rate_hz,
        even=False,
        position_mm=native.position_mm[used],
        force_mn=native.force_mn[used],
        command_mm=None,
        approach_stop=approach_stop - first,
        ramp_start=ramp_start - first,
        hold_start=hold_start - first,
        first_sample=int(marks[0]),
        surface_mm=None if trial.surface is None else trial.surface.position_mm,
    )
