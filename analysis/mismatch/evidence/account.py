"""One account of the recordings: a fitted set of effects, and the evidence for it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.evidence.heldout import predictive_deviance
from analysis.mismatch.fit.baseline import begun_anew, noise_left
from analysis.mismatch.fit.gram import Grams, gram
from analysis.mismatch.fit.law_fit import fit_laws, known_beforehand, law_columns
from analysis.mismatch.fit.noise import NoiseModel
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import ENOUGH_SHARED, FEWEST_HELD_OUT, INEXACT, ROUGH
from analysis.mismatch.model.effects import Law, OwnShape, OwnShapes, TrialState, simulate
from analysis.mismatch.model.population import OF_SITE
from analysis.recordings.trial import PHASE_NAMES

FloatArray = NDArray[np.float64]

INEXACT_KIND, SITE_KIND = "inexact", "site"
SLOW_S = 0.06
PER_PHASE, SMOOTH = 4, 2
"""Shapes of a law's inexactness in every phase, and how many of them are free in every trial anew."""
MOMENTS = 2
"""Of a kernel of a sample's length, in every phase: no recording says what happens within a sample."""
NEGLIGIBLE = 0.01
BETTER = (INEXACT, INEXACT / 3.0, INEXACT / 10.0)
"""Shares to which recordings may say that laws are right."""
SETTLES_S = 0.02
"""What of a law comes at once when a phase begins is over in such a time."""


@dataclass(frozen=True)
class Account:
    """A fitted simulation; ``steps`` are the kinds of events and oscillations in it, ``cost`` (n,) their price in nats.

    That price is what it takes to have looked for them at every time or frequency. ``inexact`` is the share
    of their size by which its laws may be off, ``granted`` the nats that this brought.
    """

    fit: StudyFit
    steps: tuple[str, ...] = ()
    cost: float = 0.0
    inexact: float = 0.0
    granted: float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """Names of everything that was added."""
        return (*(law.name for law in self.fit.shared.laws), *self.steps)

    @cached_property
    def grams(self) -> Grams:
        """Products of the laws' own columns, of a delay, and of what they may leave over in all trials alike."""
        return gram(self.fit, map(self.columns, range(len(self.fit.trials))), self.precision)

    def columns(self, j: int) -> FloatArray:
        """Return the columns (n, K) of `grams` in the j-th trial in mN, the laws' parameters first."""
        fit = self.fit
        of_laws = [law_columns(fit.trials[j], fit.states[j], fit.shared), sample_columns(fit, j)]
        return np.hstack([*of_laws, inexact_columns(fit, j)] if self.inexact else of_laws)

    @property
    def precision(self) -> FloatArray:
        """What is known (K,) of the coefficients of `columns` before any trial is weighed by them."""
        in_phases = len(self.fit.shared.laws) * len(PHASE_NAMES)
        known = np.append(known_beforehand(self.fit.shared), np.ones(in_phases * MOMENTS))
        if not self.inexact:
            return known
        return np.append(known, np.full(in_phases * PER_PHASE, self.inexact**-2))

    @cached_property
    def evidence(self) -> FloatArray:
        """Log predictive density (n,) of each trial given the others, in nats, but for what all accounts share."""
        fit = self.fit
        determinants = np.array([p.log_determinant for p in fit.projectors])
        determinants += np.array([w.log_determinant for w in fit.whiteners])
        deviance = predictive_deviance(self.grams, range(self.grams.n_added))
        return np.asarray(-0.5 * (deviance + determinants) - self.cost / len(deviance))

    def gain_over(self, other: Account) -> tuple[float, float]:
        """Return the gain in nats, with its paired error, over another account of the trials, each by its own noise."""
        gain = self.evidence - other.evidence
        return float(gain.sum()), float(np.std(gain) * np.sqrt(len(gain)))

    def let_go(self) -> Account:
        """Return the account with its evidence, but not what that was made of: columns of all trials fill memory."""
        kept = replace(self, fit=replace(self.fit))
        kept.__dict__["evidence"] = self.evidence
        return kept

    def with_laws(self, laws: tuple[Law, ...]) -> Account:
        """Return the account refitted with other laws."""
        fit = replace(self.fit, shared=replace(self.fit.shared, laws=laws))
        fit = fit_laws(fit)
        return replace(
            self, fit=fit_laws(fit.with_population(1), rounds=2) if laws else fit.with_population()
        )

    def without(self, name: str) -> Account:
        """Return the account refitted without one effect."""
        stripped = self.stripped(name)
        return stripped.with_laws(stripped.fit.shared.laws)

    def stripped(self, name: str) -> Account:
        """Return the account without one effect, and all else where it stands."""
        states = tuple(_without(s, name) for s in self.fit.states)
        laws = tuple(law for law in self.fit.shared.laws if law.name != name)
        fit = replace(self.fit, states=states, shared=replace(self.fit.shared, laws=laws))
        return replace(self, fit=fit, steps=tuple(n for n in self.steps if n != name))

    def quick(self) -> Account:
        """Return the account weighed by the quick part of its noise only.

        What looks like slow noise may be what was left out; it is judged by the noise that is left with it.
        """
        quick = self.fit.noise.quicker_than(SLOW_S)
        if quick == self.fit.noise:
            return self
        return replace(self, fit=self.fit.weighed_by(quick).with_population(1))

    def settled(self) -> Account:
        """Return the account reweighed, or begun anew if it then predicts better.

        From where it stands tissue and slow noise may stand for a part of what was added.
        """
        here = self.reweighed()
        exact = self.exact
        anew = begun_anew(exact.fit.weighed_by(exact.fit.noise.quicker_than(SLOW_S)))
        there = replace(exact, fit=anew).with_laws(anew.shared.laws).reweighed()
        return max(here, there, key=lambda account: float(account.evidence.sum()))

    def reweighed(self) -> Account:
        """Return the account with the noise measured anew from what it leaves, its laws exact or not as is likelier."""
        exact = self.exact
        exact = exact.at_noise(noise_left(exact.fit))
        if self.steps:
            # fitted where no slow noise was granted, what comes in each trial anew has taken some of it up
            exact = max(exact, exact.at_noise(noise_left(exact.fit)), key=lambda a: float(a.evidence.sum()))
        if not exact.fit.shared.laws or len(exact.fit.trials) < FEWEST_HELD_OUT:
            return exact
        if exact.inexact_to(INEXACT).evidence.sum() <= exact.evidence.sum():
            return exact
        # what laws leave over by being off has passed for slow noise until here, and bent the tissue
        rough = self.exact.quick().inexact_to(INEXACT)
        rough = rough.at_noise(noise_left(rough.fit.with_population(1)))
        best = max(rough, rough.inexact_to(ROUGH), key=lambda account: float(account.evidence.sum()))
        if best is not rough:
            best = best.at_noise(best.fit.noise)
        granted = float(best.evidence.sum() - exact.evidence.sum())
        return replace(best, granted=granted) if granted > 0.0 else exact

    def inexact_to(self, share: float) -> Account:
        """Return the account with its laws granted to be off by a share; what is linear need not be refitted."""
        return replace(self, fit=with_inexactness(self.fit, share), inexact=share)

    @cached_property
    def most_inexact(self) -> float:
        """The largest share of their size by which the recordings leave it open that the laws are off."""
        if self.inexact or not self.fit.shared.laws or len(self.fit.trials) < FEWEST_HELD_OUT:
            return max(self.inexact, INEXACT)
        likely = float(self.evidence.sum()) - ENOUGH_SHARED
        open_to = (s for s in BETTER if float(self.inexact_to(s).evidence.sum()) > likely)
        return next(open_to, BETTER[-1])

    @property
    def exact(self) -> Account:
        """The account with its laws taken as exact."""
        if not self.inexact:
            return self
        kept = [[k for k, x in enumerate(s.shapes) if x.kind != INEXACT_KIND] for s in self.fit.states]
        states = tuple(_kept(s, k) for s, k in zip(self.fit.states, kept, strict=True))
        return replace(self, fit=replace(self.fit, states=states), inexact=0.0, granted=0.0)

    def at_noise(self, noise: NoiseModel) -> Account:
        """Return the account refitted with another noise."""
        fit = self.fit.weighed_by(noise).with_population(1)
        return replace(self, fit=fit_laws(fit, rounds=3))


def with_own_sizes(fit: StudyFit) -> StudyFit:
    """Return the fit in which laws that are the skin's have a size of their own in every trial.

    Of one or two trials none can say how it differs.
    """
    if len(fit.trials) < FEWEST_HELD_OUT:
        return fit
    states = []
    for trial, state in zip(fit.trials, fit.states, strict=True):
        shapes = [
            OwnShape(law.name, "size", np.zeros(0), OF_SITE**2, kind=SITE_KIND)
            for law in fit.shared.laws
            if law.mechanism.of_site and law.mechanism.applies(trial) and law.name not in state.shapes.sizes
        ]
        states.append(state.with_shapes(shapes))
    return replace(fit, states=tuple(states))


def _without(state: TrialState, effect: str) -> TrialState:
    """Return a state without the shapes of one effect."""
    return _kept(state, [k for k, shape in enumerate(state.shapes) if shape.effect != effect])


def _kept(state: TrialState, kept: list[int]) -> TrialState:
    return replace(
        state, shapes=OwnShapes(state.shapes[k] for k in kept), coefficients=state.coefficients[kept]
    )


def with_inexactness(fit: StudyFit, share: float) -> StudyFit:
    """Return the fit in which every law may be off by a share of its size, differently in every trial and phase."""
    names = [law.name for law in fit.shared.laws]
    states = []
    for j, state in enumerate(fit.states):
        own = inexact_columns(fit, j)
        kept = [k for k, shape in enumerate(state.shapes) if shape.kind != INEXACT_KIND]
        per_law = own.shape[1] // max(len(names), 1)
        added = [
            OwnShape(names[k // per_law], "force", own[:, k], share**2, 0.0, INEXACT_KIND)
            for k in range(own.shape[1])
            if np.any(own[:, k]) and k % per_law % PER_PHASE < SMOOTH
        ]
        states.append(
            replace(
                state,
                shapes=OwnShapes((*(state.shapes[k] for k in kept), *added)),
                coefficients=np.append(state.coefficients[kept], np.zeros(len(added))),
            )
        )
    return replace(fit, states=tuple(states))


def inexactness_mn(state: TrialState, law: str) -> FloatArray:
    """Return by how much a law is off in one trial, (n,) mN, as far as it was granted to be; empty where it was not."""
    mine = [
        c * shape.shape
        for c, shape in zip(state.coefficients, state.shapes, strict=True)
        if shape.effect == law and shape.kind == INEXACT_KIND
    ]
    return np.asarray(np.sum(mine, axis=0)) if mine else np.zeros(0)


def law_effects(fit: StudyFit, j: int) -> list[FloatArray]:
    """Return what each law changes in the j-th trial's force, (n,) mN each."""
    trial, state, shared = fit.trials[j], fit.states[j], fit.shared
    whole = simulate(trial, state, shared)
    found = []
    for at in range(len(shared.laws)):
        others = shared.laws[:at] + shared.laws[at + 1 :]
        found.append(whole - simulate(trial, state, replace(shared, laws=others)))
    return found


def inexact_columns(fit: StudyFit, j: int) -> FloatArray:
    """Return what each law may leave over in every phase of the j-th trial (n, D), mN; coefficients about 0.1.

    Its effect times smooth functions, and a part of it that comes at once when the phase begins: a law that is right to
    a tenth may act less or more at once. What it so leaves over is expected there, and no evidence for another.
    """
    trial = fit.trials[j]
    columns = [np.zeros((len(trial.time_s), 0))]
    for effect in law_effects(fit, j):
        least = NEGLIGIBLE * float(np.abs(effect).max())
        for code in range(len(PHASE_NAMES)):
            inside = trial.phase == code
            columns.append(np.zeros((len(effect), PER_PHASE)))
            if np.count_nonzero(inside) > 1 and float(np.abs(effect[inside]).max()) > least:
                mine, t = effect[inside], trial.time_s[inside]
                # over what the law does there, not over time: it may act in a moment of the phase
                done = np.cumsum(np.abs(mine) * trial.counts[inside])
                u = 2.0 * done / max(float(done[-1]), 1e-300) - 1.0
                at_once = mine[np.argmax(np.abs(mine))] * np.exp((t[0] - t) / SETTLES_S)
                smooth = (mine, mine * u, mine * (1.5 * u**2 - 0.5))
                columns[-1][inside] = np.column_stack((*smooth, at_once))
    return np.hstack(columns)


def sample_columns(fit: StudyFit, j: int) -> FloatArray:
    """Return what each law leaves over in every phase of the j-th trial by acting through a kernel (n, D), mN.

    The kernel's first two moments, that of a sample's length each: sooner or later, and less sharply.
    """
    trial = fit.trials[j]
    sample_s = 1.0 / trial.sample_rate_hz
    columns = [np.zeros((len(trial.time_s), 0))]
    for effect in law_effects(fit, j):
        late = sample_s * np.gradient(effect, trial.time_s)
        spread = 0.5 * sample_s * np.gradient(late, trial.time_s)
        columns += [
            np.column_stack((late, spread)) * (trial.phase == code)[:, None]
            for code in range(len(PHASE_NAMES))
        ]
    return np.hstack(columns)
