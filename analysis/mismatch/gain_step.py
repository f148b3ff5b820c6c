"""A step that multiplies the force, against the event that was named: a shift, a loss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.events import EventAt, after, courses
from analysis.mismatch.joint import JointFit
from analysis.mismatch.linearised import column_space, linearise
from analysis.mismatch.problem import Problem

FloatArray = NDArray[np.float64]

BETTER_SHARE = 0.02
"""No law has quite the shape of a large event: what explains a little more is no better one."""


@dataclass(frozen=True, slots=True)
class GainStep:
    """A step of the force's gain that explains the trials better than the event named for them.

    ``better_by`` in units of chi2, over all trials; ``p_value`` the chance of so large a ratio of likelihoods if the
    event were true; ``rms_mn`` the step's size over the trials' samples; from ``start_s`` to ``stop_s``, medians.
    """

    instead_of: str
    better_by: float
    p_value: float
    rms_mn: float
    start_s: float
    stop_s: float


def gain_steps(problem: Problem, fit: JointFit) -> list[GainStep]:
    """Return the gain steps, at the times of named events, that explain more than these with as many coefficients.

    No event of the library multiplies the force; a bad contact of the bridge does.
    """
    found = []
    for addition in fit.simulation.additions:
        event = addition.latent
        if not isinstance(event, EventAt):
            continue
        better_by, energy, samples, starts, stops = 0.0, 0.0, 0.0, [], []
        for j, trial in enumerate(problem.trials):
            samples += float(trial.counts.sum())
            at_s = event.times_s.get(trial.label)
            if at_s is None:
                continue
            own, whitener = fit.own[j], problem.whiteners[j]
            named = event(trial, fit.simulation.tissue, own)
            force_mn = fit.simulation.force_mn(trial, own) - own.offset_mn
            stepped = (after(trial, np.array([at_s])) * force_mn * courses(trial, at_s)).T
            # the others' latents stay as fitted, the event's own go back into the residual
            latent = fit.simulation.latent_columns(trial, own)
            line = linearise(
                trial, whitener, fit.simulation, own, problem.trials, latent, fit.latents[j], frozen=True
            )
            others = line.A[:, : line.A.shape[1] - latent.shape[1]]
            back = line.r + line.A[:, others.shape[1] :] @ fit.latents[j]
            of_named, of_step = (_explained(back, others, whitener(c)) for c in (named, stepped))
            better_by += of_step - of_named
            energy += of_step * problem.white_mn**2
            starts.append(at_s)
            stops.append(float(trial.time_s[-1]))
        if better_by > BETTER_SHARE * energy / problem.white_mn**2:
            p_value = float(np.exp(-0.5 * better_by))
            rms_mn = float(np.sqrt(energy / samples))
            start_s, stop_s = float(np.median(starts)), float(np.median(stops))
            name = addition.mechanism.name
            found.append(GainStep(name, better_by, p_value, rms_mn, start_s, stop_s))
    return found


def _explained(r: FloatArray, own: FloatArray, columns: FloatArray) -> float:
    """Return how much of r (n,) columns (n, m) explain beside the trial's own columns (n, q)."""
    basis = column_space(own)
    left = columns - basis @ (basis.T @ columns)
    part = column_space(left).T @ (r - basis @ (basis.T @ r))
    return float(part @ part)
