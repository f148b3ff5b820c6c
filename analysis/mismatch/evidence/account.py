"""One account of the recordings: a fitted set of effects, and the evidence for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.evidence.heldout import predictive_deviance
from analysis.mismatch.evidence.inexactness import (
    PER_PHASE,
    exact_state,
    foreseen_columns,
    foreseen_precision,
    inexact_columns,
    inexact_effects,
    inexact_names,
    inexact_precision,
    likely_shares,
    with_inexactness,
)
from analysis.mismatch.evidence.shares import EXACT, Shares, even_shares
from analysis.mismatch.fit.baseline import begun_anew, noise_left
from analysis.mismatch.fit.contacts import contacts_begun_anew
from analysis.mismatch.fit.gram import Grams, gram
from analysis.mismatch.fit.law_fit import fit_laws, known_beforehand, law_columns, with_room
from analysis.mismatch.fit.noise import SLOW_S, NoiseModel
from analysis.mismatch.fit.steadied import steadied
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import ENOUGH_SHARED, FEWEST_HELD_OUT, INEXACT
from analysis.mismatch.model.effects import Law
from analysis.recordings.trial import PHASE_NAMES

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Account:
    """A fitted simulation; ``steps`` are the kinds of events and oscillations in it, each with its price in nats.

    That price is what it takes to have looked for it at every time or frequency. ``inexact`` are the shares of their
    size by which its effects may be off, but for those ``taken_as_exact``, ``granted`` the nats that this brought.
    """

    fit: StudyFit
    steps: Mapping[str, float] = field(default_factory=dict)
    inexact: Shares = EXACT
    granted: float = 0.0
    taken_as_exact: frozenset[str] = frozenset()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of everything that was added."""
        return (*(law.name for law in self.fit.shared.laws), *self.steps)

    @cached_property
    def may_be_off(self) -> tuple[str, ...]:
        """Names of the effects that may be granted to be off."""
        return tuple(name for name in inexact_names(self.fit) if name not in self.taken_as_exact)

    @cached_property
    def grams(self) -> Grams:
        """Products of the laws' own columns, of a delay, and of what they may leave over in all trials alike."""
        return gram(self.fit, map(self.columns, range(len(self.fit.trials))), self.precision)

    def columns(self, j: int) -> FloatArray:
        """Return the columns (n, K) of `grams` in the j-th trial in mN, the laws' parameters first."""
        fit = self.fit
        trial, effects = fit.trials[j], inexact_effects(fit, j, self.may_be_off)
        of_laws = [
            law_columns(trial, fit.states[j], fit.shared) * with_room(fit.shared),
            foreseen_columns(fit, j, effects),
        ]
        return np.hstack([*of_laws, inexact_columns(trial, effects)] if self.inexact.by_effect else of_laws)

    @property
    def precision(self) -> FloatArray:
        """What is known (K,) of the coefficients of `columns` before any trial is weighed by them."""
        foreseen = foreseen_precision(self.fit.shared, len(self.may_be_off))
        off = inexact_precision(self.inexact, self.may_be_off) if self.inexact.by_effect else np.zeros(0)
        return np.concatenate([known_beforehand(self.fit.shared), foreseen, off])

    @cached_property
    def explained_by_phase(self) -> FloatArray:
        """What each effect that is granted to be off explains in every phase (E, P), squared and weighed."""
        n = len(self.may_be_off) * len(PHASE_NAMES) * PER_PHASE
        return np.diag(self.grams.total())[-1 - n : -1 : PER_PHASE].reshape(-1, len(PHASE_NAMES))

    @cached_property
    def evidence(self) -> FloatArray:
        """Log predictive density (n,) of each trial given the others, in nats, but for what all accounts share.

        A law of hardly any size may take any of its forms without a trace, so that nothing held out tells against the
        best: each inner parameter costs a nat (Akaike, IEEE Trans. Autom. Control 19:716, 1974), and so does each share
        by which effects may be off.
        """
        fit = self.fit
        determinants = np.array([p.log_determinant for p in fit.projectors])
        determinants += np.array([w.log_determinant for w in fit.whiteners])
        deviance = predictive_deviance(self.grams, range(self.grams.n_added))
        inner = sum(p.inner for law in fit.shared.laws for p in law.parameters)
        off = np.count_nonzero(self.explained_by_phase) if self.inexact.by_effect else 0
        off += sum(law.name in self.inexact.sizes for law in fit.shared.laws)
        price = (sum(self.steps.values()) + inner + off) / len(deviance)
        return np.asarray(-0.5 * (deviance + determinants) - price)

    @property
    def nats(self) -> float:
        """The evidence of all trials."""
        return float(self.evidence.sum())

    def gain_over(self, other: Account) -> tuple[float, float]:
        """Return the gain in nats, with its paired error, over another account of the trials, each by its own noise."""
        gain = self.evidence - other.evidence
        return float(gain.sum()), float(np.std(gain) * np.sqrt(len(gain)))

    def gain_by_itself(self, other: Account) -> tuple[float, float]:
        """Return the gain in nats, with its paired error, over another account by its noise or this one's.

        What the other would gain by this noise comes of measuring noise, not of what was added.
        """
        if other.fit.noise != self.fit.noise:
            other = max(other, other.at_noise(self.fit.noise), key=lambda a: a.nats)
        return self.gain_over(other)

    def let_go(self) -> Account:
        """Return the account with its evidence, but not what that was made of: columns of all trials fill memory."""
        kept = replace(self, fit=replace(self.fit))
        kept.__dict__["evidence"] = self.evidence
        return kept

    def with_laws(self, laws: tuple[Law, ...]) -> Account:
        """Return the account refitted with other laws."""
        fit = fit_laws(replace(self.fit, shared=replace(self.fit.shared, laws=laws)))
        return replace(
            self, fit=fit_laws(fit.with_population(1), rounds=2) if laws else fit.with_population()
        )

    def without(self, name: str) -> Account:
        """Return the account refitted without one effect."""
        stripped = self.stripped(name)
        return stripped.with_laws(stripped.fit.shared.laws)

    def stripped(self, name: str) -> Account:
        """Return the account without one effect, and all else where it stands."""
        states = tuple(s.without(name) for s in self.fit.states)
        laws = tuple(law for law in self.fit.shared.laws if law.name != name)
        fit = replace(self.fit, states=states, shared=replace(self.fit.shared, laws=laws))
        if any(r.effect == name for s in self.fit.states for r in s.rhythms):
            fit = fit.weighed_by(fit.noise)
        return replace(self, fit=fit, steps={n: p for n, p in self.steps.items() if n != name})

    def quick(self) -> Account:
        """Return the account weighed by the quick part of its noise only.

        What looks like slow noise may be what was left out; it is judged by the noise that is left with it.
        """
        quick = self.fit.noise.quicker_than(SLOW_S)
        if quick == self.fit.noise:
            return self
        return replace(self, fit=self.fit.weighed_by(quick).with_population(1))

    @property
    def of_exact_laws(self) -> float:
        """The evidence of all trials but for what granting brought that laws may be off."""
        return self.nats - self.granted

    def settled(self, least: float = ENOUGH_SHARED) -> Account:
        """Return the account reweighed, or begun anew if it then predicts better by laws that are exact.

        From where it stands tissue and slow noise may stand for what was added. Rhythms settle to the ``least`` nats.
        """
        here, exact = self.weighed_anew(), self.exact
        there = exact.begun_anew(exact.fit.noise.quicker_than(SLOW_S)).weighed_anew()
        return max(here, there, key=lambda a: a.nats).with_rhythms_settled(least).granting()

    def with_rhythms_settled(self, least: float = ENOUGH_SHARED) -> Account:
        """Return the account with contacts and rhythms begun anew in turn until that gains less than ``least`` nats.

        What they have yet to gain whatever is added would be evidence for it.
        """
        best, there = self, self.touching_anew().steadied()
        while there.nats >= best.nats + least:
            best, there = there, there.touching_anew().steadied()
        return there

    def touching_anew(self) -> Account:
        """Return the account with each trial's contact begun anew beside its rhythms, if it then predicts better."""
        fit = contacts_begun_anew(self.fit)
        if fit is self.fit:
            return self
        return max(self, replace(self, fit=fit).weighed_anew(), key=lambda a: a.nats)

    def steadied(self) -> Account:
        """Return the account with its rhythms as large and steady as is likeliest beside all else."""
        best = self
        for name in dict.fromkeys(r.effect for s in self.fit.states for r in s.rhythms):
            fit = steadied(best.fit, name)
            if fit is not best.fit:
                there = replace(best, fit=fit).with_laws(fit.shared.laws).weighed_anew()
                best = max(best, there, key=lambda a: a.nats)
        return best

    def reweighed(self) -> Account:
        """Return the account with the noise measured anew from what it leaves, its laws exact or not as is likelier."""
        return self.weighed_anew().granting()

    def weighed_anew(self) -> Account:
        """Return the account, its laws taken as exact, with the noise measured anew from what they leave."""
        before = self.exact
        exact = before.at_noise(noise_left(before.fit))
        if self.steps and before.quick() is before:
            # fitted where no slow noise was granted, what comes in each trial anew has taken some of it up
            exact = max(exact, exact.at_noise(noise_left(exact.fit)), key=lambda a: a.nats)
        return exact

    def granting(self) -> Account:
        """Return the account of exact laws with them granted to be off by their likeliest shares, if that is likelier.

        What laws leave over by being off has passed for slow noise until then, and bent the tissue.
        """
        if not self.shares or self.inexact_to(self.shares).nats <= self.nats or self.rough.nats <= self.nats:
            return self
        whole = max(self, self.sized, key=lambda a: a.nats)
        granted = self.rough.nats - whole.nats
        return replace(self.rough, granted=granted) if granted > 0.0 else whole

    @cached_property
    def sized(self) -> Account:
        """The account with its laws exact in form, but each as large in every trial as the site or the day has it."""
        exact, shares = self.exact, self.shares.of_sizes
        return exact.off_by(shares) if shares and exact.inexact_to(shares).nats > exact.nats else exact

    @cached_property
    def shares(self) -> Shares:
        """The likeliest shares by which its laws are off, no slow noise being granted; of few trials none can say."""
        if not self.may_be_off or len(self.fit.trials) < FEWEST_HELD_OUT:
            return EXACT
        laws = [law.name for law in self.fit.shared.laws]
        off = self.exact.quick().inexact_to(even_shares(self.may_be_off, INEXACT, laws))
        return likely_shares(
            off.fit, map(off.columns, range(len(off.fit.trials))), off.precision, self.may_be_off
        )

    @cached_property
    def as_off(self) -> Account:
        """The account as it stands, with what its laws may leave over as far as they are likely to be off."""
        return self if self.inexact.by_effect else replace(self, inexact=self.shares)

    def off_by(self, shares: Shares) -> Account:
        """Return the account with its laws granted to be off by shares, and the noise measured beside that.

        What laws leave over may be taken for slow noise, where that was granted before. Without it, what else is
        missing may lead them astray: where they then predict worse than as exact ones, they stay where they stand.
        """
        exact = self.exact
        quick = exact.quick()
        rough = quick._off_by(shares)
        if quick is exact or rough.nats > self.of_exact_laws:
            return rough
        return max(rough, exact._off_by(shares), key=lambda a: a.nats)

    def _off_by(self, shares: Shares) -> Account:
        rough = self.inexact_to(shares)
        return rough.at_noise(noise_left(rough.fit.with_population(1)))

    @cached_property
    def rough(self) -> Account:
        """The account with its laws granted to be off by their likeliest shares."""
        return self if self.inexact.by_effect else self.off_by(self.shares)

    def inexact_to(self, shares: Shares) -> Account:
        """Return the account with its laws granted to be off by shares; what is linear need not be refitted."""
        if shares.same(self.inexact, self.may_be_off):
            return self
        return replace(self, fit=with_inexactness(self.fit, shares, self.may_be_off), inexact=shares)

    @property
    def exact(self) -> Account:
        """The account with its laws taken as exact."""
        if not self.inexact:
            return self
        states = tuple(map(exact_state, self.fit.states))
        return replace(self, fit=replace(self.fit, states=states), inexact=EXACT, granted=0.0)

    def at_noise(self, noise: NoiseModel) -> Account:
        """Return the account refitted with another noise."""
        return replace(self, fit=fit_laws(self.fit.weighed_by(noise).with_population(1), rounds=3))

    def begun_anew(self, noise: NoiseModel) -> Account:
        """Return the account with its tissues begun anew beside its laws, weighed by a noise."""
        return replace(self, fit=begun_anew(self.fit.weighed_by(noise))).with_laws(self.fit.shared.laws)

    def best_at(self, noise: NoiseModel) -> Account:
        """Return the account refitted with another noise, or begun anew: slow noise may have left tissues anywhere."""
        return max(self.at_noise(noise), self.begun_anew(noise), key=lambda a: a.nats)
