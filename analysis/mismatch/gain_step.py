"""A step that multiplies the force, against the event that was named: a shift, a loss."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.event_at import SAME_EVENT_S, EventAt, after, courses
from analysis.mismatch.joint import JointFit
from analysis.mismatch.linearised import column_space, linearise, weighed_residual
from analysis.mismatch.problem import Problem

FloatArray = NDArray[np.float64]

BETTER_SHARE = 0.005
"""No law has quite the shape of a large event: what explains a little more is no better one."""


@dataclass(frozen=True, slots=True)
class GainStep:
    """Steps of the force's gain that explain the trials better than the events named for them.

    ``better_by`` in units of chi2, over all trials; ``p_value`` the chance of so large a ratio of likelihoods if the
    events were true; ``rms_mn`` the steps' size over the trials' samples; from ``start_s`` to ``stop_s``, medians.
    """

    instead_of: str
    better_by: float
    p_value: float
    rms_mn: float
    start_s: float
    stop_s: float


def gain_step(problem: Problem, fit: JointFit) -> GainStep | None:
    """Return the gain steps, at the times of all named events, if they explain more than these do.

    No event of the library multiplies the force; a bad contact of the bridge does. Each coefficient is charged 2.
    """
    events = [a.latent for a in fit.simulation.additions if isinstance(a.latent, EventAt)]
    better_by, energy, samples, starts, stops = 0.0, 0.0, 0.0, [], []
    for j, trial in enumerate(problem.trials):
        samples += float(trial.counts.sum())
        times = _apart([e.times_s[trial.label] for e in events if trial.label in e.times_s])
        if not times:
            continue
        own, whitener = fit.own[j], problem.whiteners[j].tight
        force_mn = fit.simulation.force_mn(trial, own) - own.offset_mn
        stepped = np.vstack([after(trial, np.array([t])) * force_mn * courses(trial, t) for t in times]).T
        # where tissues were seen to scatter, the trial has one of its own in both accounts
        one_tissue = not problem.scatter_mn
        line = linearise(
            trial, whitener, fit.simulation, own, problem.trials, fit.latents[j], frozen=one_tissue
        )
        of_event = np.concatenate(
            [
                np.full(a.latent.n_columns(trial), isinstance(a.latent, EventAt))
                for a in fit.simulation.additions
                if a.latent is not None
            ]
        )
        mine = np.concatenate([np.zeros(line.A.shape[1] - len(of_event), dtype=bool), of_event])
        basis = column_space(np.hstack([line.A[:, ~mine], line.J]))
        without = np.where(of_event, 0.0, fit.latents[j])
        bare = weighed_residual(trial, whitener, fit.simulation, own, without)
        of_named = _left(bare, basis) - _left(line.r, basis)
        of_step = _explained(bare, basis, whitener(stepped))
        better_by += of_step - of_named - 2.0 * float(stepped.shape[1] - of_event.sum())
        energy += of_step * problem.white_mn**2
        starts.append(times[0])
        stops.append(float(trial.time_s[-1]))
    if not starts or better_by <= BETTER_SHARE * energy / problem.white_mn**2:
        return None
    return GainStep(
        " and ".join(e.mechanism.name.replace("_", " ") for e in events),
        better_by,
        float(np.exp(-0.5 * better_by)),
        float(np.sqrt(energy / samples)),
        float(np.median(starts)),
        float(np.median(stops)),
    )


def _apart(times_s: Sequence[float]) -> list[float]:
    """Return times in order, those of one event only once."""
    found: list[float] = []
    for t in sorted(times_s):
        if not found or t - found[-1] > SAME_EVENT_S:
            found.append(t)
    return found


def _left(r: FloatArray, basis: FloatArray) -> float:
    """Return the energy of r (n,) beside an orthonormal basis (n, q)."""
    left = r - basis @ (basis.T @ r)
    return float(left @ left)


def _explained(r: FloatArray, basis: FloatArray, columns: FloatArray) -> float:
    """Return how much of r (n,) columns (n, m) explain beside an orthonormal basis (n, q)."""
    left = columns - basis @ (basis.T @ columns)
    part = column_space(left).T @ (r - basis @ (basis.T @ r))
    return float(part @ part)
