"""Laws fitted to all trials at once, every trial's tissue free: Gauss-Newton on what the trials share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from analysis.mismatch.fit.gram import gram
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import STRETCHED
from analysis.mismatch.model.effects import (
    TISSUE_SIZE,
    Law,
    Shared,
    TrialState,
    own_effects,
    simulate,
)
from analysis.simulation.cells import CellTrial
from analysis.simulation.mechanism import Parameter

FloatArray = NDArray[np.float64]

DELAY_SAMPLES = 1.0
"""How well two channels are at one, samples: a sample or so of skew is no lag of the sensor."""
STEP = 1e-5
"""Of a finite difference: where laws and tissue trade, what tells them is a thousandth of what each changes."""
ROUNDS = 10
DONE = 0.3
"""Chi2 that a step must gain, by noise as large as what is left: weighed by less, much gains little."""
LARGEST_LOG_STEP = 0.7
LARGEST_TISSUE_STEP = 0.5
NO_ROOM = 1e-12
INNER_LOG = 1.5
"""An inner parameter on a logarithm is known to so much before a fit, from the textbook's value."""
SIZE_LOG = 3.0
"""And a size on a logarithm to so much."""
INNER_SHARE = 0.3
"""A linear parameter that is inner, or a power, is known to this share of its range."""


def parameter_scale(p: Parameter, value: float, typical: float) -> float:
    """Return the size of a finite difference in units of which a parameter's law is smooth."""
    if p.scale == "log":
        return 1.0
    if p.inner:
        # as it is known beforehand: the textbook's value may be zero
        return INNER_SHARE * (p.upper - p.lower)
    return max(abs(p.to_fit(value)), 0.1 * abs(p.to_fit(typical)), 1e-12)


def law_columns(trial: CellTrial, state: TrialState, shared: Shared) -> FloatArray:
    """Return the change of force (n, P) by every free parameter of the laws on its fit's scale, and by delay, mN."""
    own = own_effects(state)
    base = simulate(trial, state, shared, own)
    columns = []
    for at, law in enumerate(shared.laws):
        for p in law.parameters:
            if not law.mechanism.applies(trial):
                columns.append(np.zeros_like(base))
                continue
            typical = law.mechanism.typical.get(p.name, law.values[p.name])
            h = STEP * parameter_scale(p, law.values[p.name], typical)
            changed = with_value(shared, at, p, p.to_fit(law.values[p.name]) + h)
            real = p.to_fit(changed.laws[at].values[p.name]) - p.to_fit(law.values[p.name])
            if abs(real) < 0.5 * h:
                changed = with_value(shared, at, p, p.to_fit(law.values[p.name]) - h)
                real = p.to_fit(changed.laws[at].values[p.name]) - p.to_fit(law.values[p.name])
            columns.append((simulate(trial, state, changed, own) - base) / (real or h))
    # what the channels' delay changes stands last: by half a sample to either side, as samples have corners between
    late, early = (replace(shared, delay_samples=shared.delay_samples + by) for by in (0.5, -0.5))
    columns.append(simulate(trial, state, late, own) - simulate(trial, state, early, own))
    return np.column_stack(columns)


def with_value(shared: Shared, at: int, p: Parameter, fitted: float) -> Shared:
    """Return what is shared with one parameter of one law changed, kept within its bounds."""
    laws = list(shared.laws)
    laws[at] = replace(laws[at], values={**laws[at].values, p.name: p.from_fit(fitted)})
    return replace(shared, laws=tuple(laws))


def vector(shared: Shared) -> FloatArray:
    """Return the free parameters of laws and the delay (P,) on the scale of their fit."""
    values = [p.to_fit(law.values[p.name]) for law in shared.laws for p in law.parameters]
    return np.array([*values, shared.delay_samples])


def at_vector(shared: Shared, values: FloatArray) -> Shared:
    """Return what is shared with its laws' free parameters at ``values`` (P,), kept within bounds."""
    k = 0
    for at, law in enumerate(shared.laws):
        for p in law.parameters:
            shared = with_value(shared, at, p, float(values[k]))
            k += 1
    return replace(shared, delay_samples=float(np.clip(values[k], *shared.delay_ends)))


def law_prior(laws: Sequence[Law]) -> tuple[FloatArray, FloatArray]:
    """Return what is known of free parameters beforehand: precision (P,) and centre (P,) on the scale of the fit."""
    precision, centre = [], []
    for law in laws:
        for p in law.parameters:
            middle = p.to_fit(law.mechanism.null[p.name])
            spread = np.inf
            if p.scale == "log" and p.inner:
                spread = INNER_LOG
            elif p.scale == "log" and p.name != law.mechanism.amplitude:
                middle, spread = p.to_fit(law.values[p.name]), SIZE_LOG
            elif p.scale != "log" and (p.inner or p.name != law.mechanism.amplitude):
                # a power is no size: what trials leave open of it would run to the end of its range
                spread = INNER_SHARE * (p.upper - p.lower)
            precision.append(1.0 / spread**2)
            centre.append(middle)
    return np.array([*precision, DELAY_SAMPLES**-2]), np.array([*centre, 0.0])


def known_beforehand(shared: Shared) -> FloatArray:
    """Return the precision (P,) with which free parameters are known before any trial is weighed by them.

    A size is known to about itself: what trials leave open of it makes their prediction wide, not wild.
    """
    precision = law_prior(shared.laws)[0]
    parameters = [(law, p) for law in shared.laws for p in law.parameters]
    for k, (law, p) in enumerate(parameters):
        if not precision[k]:
            away = p.to_fit(law.values[p.name]) - p.to_fit(law.mechanism.null[p.name])
            precision[k] = SIZE_LOG**-2 if p.scale == "log" else max(away**2, 1e-24) ** -1
    return precision


def with_room(shared: Shared) -> FloatArray:
    """Return one (P,) for every free parameter of laws and the delay, nothing for one that ended at a bound.

    The trials would have it beyond, where it can't go: it takes nothing up that it has left.
    """
    parameters = [(p, law.values[p.name]) for law in shared.laws for p in law.parameters]
    ended = [any(at_ends(p, value)) for p, value in parameters]
    return 1.0 - np.array([*ended, shared.delay_samples in shared.delay_ends])


def fit_laws(fit: StudyFit, rounds: int = ROUNDS) -> StudyFit:
    """Return the fit with its laws' free parameters, the population's mean and all own parameters at their best."""
    precision, centre = law_prior(fit.shared.laws)
    P = len(precision)
    if not fit.shared.laws:
        return fit.with_states()

    def cost(f: StudyFit) -> float:
        return f.cost + float(precision @ (vector(f.shared) - centre) ** 2)

    fit = fit.with_states(rounds=8)
    now = cost(fit)
    damping = 1e-6
    for _ in range(rounds):
        grams = gram(
            fit, (law_columns(t, s, fit.shared) for t, s in zip(fit.trials, fit.states, strict=True))
        )
        N = grams.total()
        size = TISSUE_SIZE + P
        A, b = N[:size, :size].copy(), N[:size, -1].copy()
        values = vector(fit.shared)
        A[TISSUE_SIZE:, TISSUE_SIZE:] += np.diag(precision)
        b[TISSUE_SIZE:] += precision * (centre - values)
        scale = np.sqrt(np.maximum(np.diag(A), 1e-30))
        done, gained = DONE * max(now / grams.n_cells, 1.0), 0.0
        for _ in range(6):
            C = A / np.outer(scale, scale) + (damping + 1e-12) * np.eye(size)
            # the most that a step can gain, were nothing bounded
            if float((b / scale) @ np.linalg.solve(C, b / scale)) < done:
                break
            room = fit.population.lowest - fit.population.mean
            tried = _stepped(fit, bounded_step(fit.shared, C, b / scale, scale, room))
            new = cost(tried)
            if new < now:
                gained = now - new
                fit, now, damping = tried, new, max(damping / 10.0, 1e-9)
                break
            damping = max(damping, 1e-4) * 10.0
        if gained < done:
            break
    return centred(fit)


def centred(fit: StudyFit) -> StudyFit:
    """Return the fit with what its trials' own values have in common put into the laws' values: no force changes.

    A step of a size alone, its trials' own following, is a long way along a narrow valley.
    """
    for at, p in ((at, p) for at, law in enumerate(fit.shared.laws) for p in law.of_site):
        law = fit.shared.laws[at]
        places = [state.shapes.law_values.get((law.name, p.name)) for state in fit.states]
        own = [s.coefficients[k] for s, k in zip(fit.states, places, strict=True) if k is not None]
        value = law.values[p.name]
        known = sum(1.0 / s.shapes[k].prior for s, k in zip(fit.states, places, strict=True) if k is not None)
        mean = float(np.mean(own)) if own else 0.0
        if known * mean**2 < DONE or not value:
            continue
        shared = with_value(fit.shared, at, p, p.to_fit(value * float(np.exp(mean))))
        step = float(np.log(shared.laws[at].values[p.name] / value))
        states = [
            replace(s, coefficients=s.coefficients - step * (np.arange(len(s.coefficients)) == k))
            for s, k in zip(fit.states, places, strict=True)
        ]
        fit = replace(fit, states=tuple(states), shared=shared)
    return fit


def bounded_step(
    shared: Shared, C: FloatArray, b: FloatArray, scale: FloatArray, room: FloatArray
) -> FloatArray:
    """Return the step (5 + P,) nearest to C (step * scale) = b, C positive definite, that keeps within all bounds.

    ``room`` (5,) is how far down the tissue may go.

    Stopped at a bound after the others' step was found, a parameter would leave them where none of them alone should go
    (Stark and Parker, Comput. Stat. 10:129, 1995).
    """
    L = np.linalg.cholesky(C)
    lower, upper = _largest_steps(shared, room)
    solved = lsq_linear(L.T, np.linalg.solve(L, b), (lower * scale, upper * scale), method="bvls")
    return np.asarray(solved.x / scale)


def _largest_steps(shared: Shared, room: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far down and up (5 + P,) tissue and free parameters may go in one step."""
    values = vector(shared)
    ends = [p.ends for law in shared.laws for p in law.parameters]
    ends.append(shared.delay_ends)
    logarithmic = [p.scale == "log" for law in shared.laws for p in law.parameters]
    most = np.where([*logarithmic, False], LARGEST_LOG_STEP, np.inf)
    lower = np.minimum(np.maximum(np.array([e[0] for e in ends]) - values, -most), 0.0)
    upper = np.maximum(np.minimum(np.array([e[1] for e in ends]) - values, most), 0.0)
    tissue = np.full(TISSUE_SIZE, LARGEST_TISSUE_STEP)
    # a parameter without room on either side would leave nothing between its bounds
    lowest = np.concatenate([np.minimum(np.maximum(room, -tissue), 0.0), lower]) - NO_ROOM
    return lowest, np.concatenate([tissue, upper + NO_ROOM])


def _stepped(fit: StudyFit, step: FloatArray) -> StudyFit:
    """Return the fit with its shared parameters moved by a step, own parameters following."""
    lowest, tissue = fit.population.lowest, step[:TISSUE_SIZE]
    mean = np.maximum(fit.population.mean + tissue, lowest)
    shared = at_vector(fit.shared, vector(fit.shared) + step[TISSUE_SIZE:])
    states = tuple(
        replace(s, log_tissue=np.maximum(s.log_tissue + tissue, lowest)) if s.has_tissue else s
        for s in fit.states
    )
    population = replace(fit.population, mean=mean)
    return replace(fit, shared=shared, states=states, population=population).with_states(rounds=5, near=fit)


def at_bound(law: Law) -> bool:
    """Whether what a law is like ended at a limit, or within it far from the textbook: it is not the right one."""
    precision, centre = law_prior([law])
    values = vector(Shared((law,)))
    inner = [p.inner for p in law.parameters]
    away = np.abs(values - centre)[:-1] * np.sqrt(precision[:-1])
    if np.any(away[inner] > STRETCHED):
        return True
    return any(
        _ended(p, law.values[p.name], law.mechanism.null[p.name]) for p in law.parameters if not p.inner
    )


def _ended(p: Parameter, value: float, null: float) -> bool:
    """Whether a parameter lies at an end of its range at which its law is not nothing."""
    lower, upper = at_ends(p, value)
    return (lower and p.ends[0] != p.to_fit(null)) or upper


def at_ends(p: Parameter, value: float) -> tuple[bool, bool]:
    """Whether a parameter lies at the lower and at the upper end of its range."""
    here, (lower, upper) = p.to_fit(value), p.ends
    near = 1e-6 * max(1.0, abs(here))
    return here - lower <= near, upper - here <= near
