"""A force that its instrument gives anew less often than it is sampled: only its new values are readings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from analysis.recordings.trial import Phase, Trial
from analysis.simulation.arm_path import ArmPath
from analysis.simulation.motion import Motion

FloatArray = NDArray[np.float64]
Path = TypeVar("Path", bound=ArmPath)

LONGEST = 32
"""Samples for which a value may be held: 4 ms at 8000 a second, as of an instrument that gives 250 a second."""
CHANGES = 3.0
"""Times as much that a force changes by where it is new than elsewhere: else most of it is not held. Where noise alone
is held, and the force goes on, it is twice as much."""
FEWEST = 100
"""Values that are told from chance: means of so many changes differ by a fifth, of noise with heavy tails by more."""


def held_for(trials: Iterable[Trial]) -> int:
    """Return for how many samples a force is held before it is given anew, in all trials; 1 where it never is."""
    return min((_held(trial.force_v) for trial in trials if trial.native is None), default=1)


def with_readings(trial: Trial, motion: Motion, held: int) -> tuple[Trial, Motion]:
    """Return a trial and its motion with one sample for each new value of the force, where it is held for so many.

    A value is what the force was when it was given; by the next the arm has moved on. The motion is that of all
    samples: its corners lie between those that are kept. A trial whose force is not held stays as it is.
    """
    if held < 2 or trial.native is not None:
        return trial, motion
    first = int(_changes(trial.force_v, held).argmax())
    anew = slice(first, None, held)

    def at(sample: int) -> int:
        return max(-((first - sample) // held), 0)

    read = replace(
        trial,
        sample_rate_hz=trial.sample_rate_hz / held,
        position_v=trial.position_v[anew],
        force_v=trial.force_v[anew],
        command_v=None if trial.command_v is None else trial.command_v[anew],
        phases=tuple(Phase(p.name, at(p.start), at(p.stop)) for p in trial.phases),
        surface=None if trial.surface is None else replace(trial.surface, sample=at(trial.surface.sample)),
        events=tuple(replace(event, sample=at(event.sample)) for event in trial.events),
        other_channels={name: channel[anew] for name, channel in trial.other_channels.items()},
    )
    other = motion.if_noise_lasts
    moved = replace(
        _samples_of(motion, anew),
        kinks=np.unique(np.minimum([at(int(k)) for k in motion.kinks], read.n_samples - 1)),
        if_noise_lasts=None if other is None else _samples_of(other, anew),
    )
    return read, moved


def _samples_of(path: Path, samples: slice) -> Path:
    """Return some samples of all that is told of each."""
    n = len(path.position_mm)
    every = {f.name: getattr(path, f.name) for f in fields(path)}
    return replace(path, **{name: x[samples] for name, x in every.items() if np.shape(x)[:1] == (n,)})


def held_note(held: int) -> tuple[str, ...]:
    """Return what a reader must know of a force that is held for so many samples."""
    if held < 2:
        return ()
    return (
        f"The force is a new value only once in {held} samples: its instrument is read faster than it measures. One "
        "sample of each value is compared.",
    )


def _held(force_v: FloatArray) -> int:
    """Return for how many samples a force (N,) is held; 1 where it is not."""
    for held in range(min(LONGEST, len(force_v) // FEWEST), 1, -1):
        changes = np.sort(_changes(force_v, held))
        if changes[-1] > CHANGES * changes[-2]:
            return held
    return 1


def _changes(force_v: FloatArray, held: int) -> FloatArray:
    """Return by how much a force (N,) changes on average from the sample before, at each place (held,) of a value."""
    steps = np.abs(np.diff(force_v, prepend=force_v[0]))[: len(force_v) // held * held]
    return np.asarray(steps.reshape(-1, held).mean(axis=0))
