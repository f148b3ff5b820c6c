"""All trials fitted: each its own tissue, the population they are drawn from, the laws they share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from weakref import ref

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.fit.noise import NoiseModel
from analysis.mismatch.fit.own import ForceColumns, OwnColumns, Projector, force_columns, own_columns
from analysis.mismatch.fit.rhythms import followed
from analysis.mismatch.fit.trial_fit import ROUNDS, fit_trial, penalty
from analysis.mismatch.fit.whitener import Whitener
from analysis.mismatch.levels import FEWEST_HELD_OUT
from analysis.mismatch.model.effects import OwnShape, Shared, TrialState, simulate
from analysis.mismatch.model.population import FEWEST_ALIKE, OF_SITE, Population, estimate, site_variance
from analysis.mismatch.model.rhythm import HARMONIC
from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]

COLUMNS = {"force_columns", "own", "projectors"}
"""What a fit computes of itself and may compute again."""
AT_REST = ("hold", "dwell")
MOST_HELD_BYTES = 5e8
"""A quarter of the 2 GB within which a diagnosis stays."""


class Held:
    """The fits of a study that hold their columns: those of all that a search comes to would fill memory."""

    def __init__(self) -> None:
        self._fits: list[ref[StudyFit]] = []

    def take(self, fit: StudyFit) -> None:
        """Hold a fit's columns as the latest. The earliest let go of theirs; what is needed again is computed anew."""
        held = [*(other for at in self._fits if (other := at()) not in (None, fit)), fit]
        while len(held) > 1 and sum(each.bytes_held for each in held) > MOST_HELD_BYTES:
            earliest = held.pop(0)
            for name in COLUMNS:
                vars(earliest).pop(name, None)
        self._fits = [ref(each) for each in held]


@dataclass(frozen=True, eq=False)
class StudyFit:
    """A simulation fitted to trials: what they share, what is each one's own, population and noise."""

    trials: tuple[CellTrial, ...]
    whiteners: tuple[Whitener, ...]
    noise: NoiseModel
    shared: Shared
    states: tuple[TrialState, ...]
    population: Population
    held: Held = field(default_factory=Held, repr=False)

    @cached_property
    def force_columns(self) -> tuple[ForceColumns, ...]:
        """Each trial's own columns in mN, whatever its noise."""
        self.held.take(self)
        return tuple(force_columns(t, s, self.shared) for t, s in zip(self.trials, self.states, strict=True))

    @cached_property
    def own(self) -> tuple[OwnColumns, ...]:
        """Each trial's own columns, weighed."""
        self.held.take(self)
        return tuple(
            own_columns(f, w, s, self.population)
            for f, w, s in zip(self.force_columns, self.whiteners, self.states, strict=True)
        )

    @cached_property
    def projectors(self) -> tuple[Projector, ...]:
        """What takes each trial's own parameters out of columns."""
        self.held.take(self)
        return tuple(Projector(own, w) for own, w in zip(self.own, self.whiteners, strict=True))

    @property
    def bytes_held(self) -> int:
        """About what the columns take that were computed: those of the force, and the others as much again each."""
        if "force_columns" not in vars(self):
            return 0
        return sum(f.columns_mn.nbytes for f in self.force_columns) * len(COLUMNS & vars(self).keys())

    @cached_property
    def cost(self) -> float:
        """Chi2 of all trials plus that of their own parameters against the population."""
        whole = sum(penalty(s, self.population) for s in self.states)
        for j, whitener in enumerate(self.whiteners):
            r = whitener(self.trials[j].force_mn - simulate(self.trials[j], self.states[j], self.shared))
            whole += float(r @ r)
        return whole

    def force_mn(self, j: int) -> FloatArray:
        """Return the simulated force (n,) of the j-th trial, with what its rhythms are most likely to add."""
        trial, state = self.trials[j], self.states[j]
        force = simulate(trial, state, self.shared)
        amplitudes = self.whiteners[j].amplitudes(trial.force_mn - force)
        for rhythm, of_it in zip(state.rhythms, amplitudes, strict=True):
            force = force + rhythm.line_mn(of_it)
        return force

    @cached_property
    def left_mn(self) -> float:
        """What the simulation leaves of the recordings, rms of a sample."""
        squares = sum(t.counts * t.fitted @ self.residual_mn(j) ** 2 for j, t in enumerate(self.trials))
        return float(np.sqrt(squares / max(sum(t.counts @ t.fitted for t in self.trials), 1)))

    def residual_mn(self, j: int) -> FloatArray:
        """Return what is left (n,) of the j-th trial's force, by cell."""
        return self.trials[j].force_mn - self.force_mn(j)

    def full_residual_mn(self, j: int) -> FloatArray:
        """Return what is left of every sample (N,)."""
        t = self.trials[j]
        return np.asarray(t.full_force_mn - t.read_at_samples(self.force_mn(j)))

    def drawn_residual_mn(self, j: int) -> FloatArray:
        """Return every sample (N,) of the j-th trial's residual with a draw of what is left open of its rhythms.

        What is taken for a rhythm is in part noise.
        """
        trial, residual, rhythms = self.trials[j], self.full_residual_mn(j), self.states[j].rhythms
        drawn = self.whiteners[j].left_open(np.random.default_rng(j)) if rhythms else []
        for rhythm, of_it in zip(rhythms, drawn, strict=True):
            residual = residual + trial.at_samples(rhythm.line_mn(of_it))
        return residual

    def unrounded_residual_mn(self, j: int) -> FloatArray:
        """Return every sample (N,) of the j-th trial's residual as drawn, and what a converter rounded it from."""
        trial, drawn = self.trials[j], self.drawn_residual_mn(j)
        if trial.levels is None:
            return drawn
        there_mn = trial.at_samples(self.force_mn(j)) + self.full_residual_mn(j) - drawn
        return trial.levels.drawn_error(trial.full_force_mn, there_mn, np.random.default_rng(j))

    def with_states(self, rounds: int = ROUNDS, near: StudyFit | None = None) -> StudyFit:
        """Return the fit with every trial's own parameters at their best; ``near`` is a fit close to this one."""
        fitted = [
            fit_trial(t, w, s, self.shared, self.population, own, rounds, near=near is not None)
            for t, w, s, own in zip(self.trials, self.whiteners, self.states, (near or self).own, strict=True)
        ]
        states = tuple(state for state, _ in fitted)
        moved = any(new is not old for new, old in zip(states, self.states, strict=True))
        fit = replace(self, states=states) if moved else self
        fit.__dict__["cost"] = sum(cost for _, cost in fitted)
        return fit

    def with_population(self, passes: int = 2) -> StudyFit:
        """Return the fit with population and own parameters estimated in turn; a single trial is no population."""
        if sum(s.has_tissue for s in self.states) < 2:
            return self.following().with_states()
        fit = near = self
        for _ in range(passes):
            fit = fit.following().with_states()
            likelihoods = [
                tissue_likelihood(own, s) for own, s in zip(fit.own, fit.states, strict=True) if s.has_tissue
            ]
            population = estimate(likelihoods, fit.population)
            states = rhythms_sized(fit, values_scattered(fit))
            near, fit = fit, replace(fit, states=states, population=population)
        return fit.with_states(near=near)

    def following(self) -> StudyFit:
        """Return the fit with its rhythms where they are most probable, and their forces in a line about that."""
        if not any(s.rhythms for s in self.states):
            return self
        states, whiteners = [], []
        for trial, there, weighed in zip(self.trials, self.states, self.whiteners, strict=True):
            state, whitener = followed(trial, there, self.shared, weighed)
            states.append(state)
            whiteners.append(whitener)
        return replace(self, states=tuple(states), whiteners=tuple(whiteners))

    def weighed_by(self, noise: NoiseModel) -> StudyFit:
        """Return the fit with cells weighed by another noise."""
        whiteners = (Whitener(t, noise, s.rhythms) for t, s in zip(self.trials, self.states, strict=True))
        fit = replace(self, noise=noise, whiteners=tuple(whiteners))
        if "force_columns" in vars(self):  # those of the force are the same under any noise
            vars(fit)["force_columns"] = self.force_columns
        return fit


def with_own_values(fit: StudyFit) -> StudyFit:
    """Return the fit in which what is the skin's of laws is each trial's own: their size, and their time.

    Of one or two trials none can say how it differs.
    """
    if len(fit.trials) < FEWEST_HELD_OUT:
        return fit
    states = []
    for trial, state in zip(fit.trials, fit.states, strict=True):
        shapes = [
            OwnShape(law.name, "value", np.zeros(0), OF_SITE**2, kind=p.name)
            for law in fit.shared.laws
            for p in law.of_site
            if law.mechanism.applies(trial) and (law.name, p.name) not in state.shapes.law_values
        ]
        states.append(state.with_shapes(shapes))
    return replace(fit, states=tuple(states))


def tissue_likelihood(own: OwnColumns, state: TrialState) -> tuple[FloatArray, FloatArray]:
    """Return what a trial alone says of its log constants: information (5, 5), and that times the estimate (5,)."""
    others = np.array([k for k in range(own.n_own) if not own.tissue.start <= k < own.tissue.stop], dtype=int)
    J, X = own.columns[:, own.tissue], own.columns[:, others]
    prior = own.prior[np.ix_(others, others)]
    # the least of all solutions: a contact out of reach moves nothing, and takes nothing
    taken = np.linalg.lstsq(X.T @ X + prior, X.T @ J, rcond=None)[0]
    # squares, not their difference: what a trial says little of would be less than nothing
    left = J - X @ taken
    H = left.T @ left + taken.T @ prior @ taken
    # at the fitted state the others' gradient is zero with their pull
    g = left.T @ own.residual - taken.T @ own.pull[others]
    return H, H @ state.log_tissue + g


def values_scattered(fit: StudyFit) -> tuple[TrialState, ...]:
    """Return the trials' states with what is known of laws' own values as their scatter between trials tells it.

    What does not vary is known not to, and costs no power.
    """
    states = fit.states
    for of in ((law.name, p.name) for law in fit.shared.laws for p in law.of_site):
        at = {j: s.shapes.law_values[of] for j, s in enumerate(states) if of in s.shapes.law_values}
        if len(at) < FEWEST_ALIKE:
            continue
        likelihoods = [value_likelihood(fit.own[j], states[j], k) for j, k in at.items()]
        variance = site_variance(*np.array(likelihoods).T)
        states = tuple(s.known_to(at[j], variance) if j in at else s for j, s in enumerate(states))
    return states


def rhythms_sized(fit: StudyFit, states: Sequence[TrialState]) -> tuple[TrialState, ...]:
    """Return the trials' states with their slow rhythms known to be as large beforehand as all trials tell.

    The mean square of what is drawn about zero, by a step of EM: one that is known to be smaller is drawn to nothing.
    Overtones keep their shares of it.
    """
    found: dict[str, list[float]] = {}
    for own, state in zip(fit.own, fit.states, strict=True):
        rhythms = {shape.effect for shape in state.shapes if shape.kind == HARMONIC}
        for effect in rhythms:
            mine = np.array(state.shapes.of(effect))
            known = np.array([state.shapes[k].prior for k in mine])
            squares = state.coefficients[mine] ** 2 + np.diag(own.covariance)[own.tissue.stop + mine]
            found.setdefault(effect, []).extend(squares / known)
    by = {effect: float(np.mean(of_it)) for effect, of_it in found.items()}
    return tuple(state.larger(by) for state in states)


def value_likelihood(own: OwnColumns, state: TrialState, k: int) -> tuple[float, float]:
    """Return what a trial alone says of its k-th own shape: information, and that times the estimate."""
    at = own.tissue.stop + k
    variance = float(own.covariance[at, at])
    return max(1.0 / variance - 1.0 / state.shapes[k].prior, 0.0), float(state.coefficients[k]) / variance


def sampled_alike(trials: Sequence[CellTrial]) -> bool:
    """Whether all trials were sampled evenly, and at one rate."""
    rates = [t.sample_rate_hz for t in trials]
    return float(np.ptp(rates)) <= 1e-6 * max(rates) and all(t.uneven_s is None for t in trials)


def tells_noise(trials: Sequence[CellTrial]) -> bool:
    """Whether noise can be told from what laws leave over: by what differs between trials, or by spectra at rest."""
    at_rest = any(t.in_phase(name).any() for t in trials for name in AT_REST)
    return len(trials) >= FEWEST_HELD_OUT or (at_rest and sampled_alike(trials))
