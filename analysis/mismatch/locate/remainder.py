"""What an account leaves over that is no noise: evidence for any shape, common to the trials or different in each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.gram import solve
from analysis.mismatch.fit.law_fit import vector
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import ENOUGH_OWN, SMALL_SHARE
from analysis.mismatch.locate.outliers import find_outliers
from analysis.mismatch.locate.quiet import out_of_contact
from analysis.mismatch.locate.session import NO_TREND, Trend, find_trend
from analysis.mismatch.locate.transients import NO_BURSTS, Bursts, find_bursts
from analysis.mismatch.locate.windows import CommonShape, common_shape, own_evidence
from analysis.mismatch.model.effects import TISSUE_SIZE
from analysis.recordings.trial import PHASE_NAMES

FloatArray = NDArray[np.float64]


class Wander(NamedTuple):
    """What wanders in contact alone: evidence in nats, share of everything beyond the noise, the force's rms, mN."""

    nats: float
    share: float
    rms_mn: float


NO_WANDER = Wander(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Remainder:
    """Evidence in nats for a shape that all trials have in common, for what differs from trial to trial, for bursts.

    ``trend`` is what changes over the session; ``inexact`` the part of the evidence for the laws that comes of granting
    that they are off.

    ``share`` is what part of everything beyond the noise it is, weighed by the noise that is left beside it. What
    wanders in contact alone counts from a tenth of a tolerance on: no living skin keeps quite still.
    """

    common: float
    own: float
    share: float
    bursts: Bursts
    trend: Trend = NO_TREND
    inexact: float = 0.0
    wander: Wander = NO_WANDER

    def beyond(self, tolerance_mn: float) -> Remainder:
        """Return the remainder with what wanders in contact alone, if that is no small share of a tolerance."""
        if self.wander.rms_mn < SMALL_SHARE * tolerance_mn or self.wander.nats <= self.evidence:
            return self
        return replace(self, own=self.wander.nats, share=self.wander.share)

    @property
    def evidence(self) -> float:
        """Evidence for whatever it is."""
        return max(self.common, self.own, self.bursts.evidence, 0.0)

    @property
    def lasts(self) -> bool:
        """Whether more than noise is left that is neither a burst nor a trend: it is somewhere in the phases."""
        return max(self.common, self.own, self.wander.nats) > ENOUGH_OWN

    @property
    def significant(self) -> bool:
        """Whether it is more than noise."""
        return self.evidence > ENOUGH_OWN or self.trend.significant


@dataclass(frozen=True)
class Nameless:
    """What effects explain that no mechanism names: their share of all evidence, and their rms force, mN.

    The force is what nothing else explains, in the phase in which it is largest, over all trials. ``by_name`` is the
    account of what has a name.
    """

    share: float
    rms_mn: float
    by_name: Account

    @property
    def left(self) -> StudyFit:
        """The fit to what is left by all that has a name."""
        return unexpected(self.by_name)


def is_small(share: float, rms_mn: float, tolerance_mn: float) -> bool:
    """Whether what no mechanism names is no more than what laws leave over by being inexact."""
    return share < SMALL_SHARE and rms_mn < tolerance_mn


def nameless_of(account: Account, nothing: Account, named: Sequence[str]) -> Nameless:
    """Return what an account's effects other than the named ones explain, all by the account's noise.

    ``nothing`` is the account without effects at that noise.
    """
    without = account
    for name in (n for n in account.names if n not in named):
        without = without.without(name)
    if without is account:
        return Nameless(0.0, 0.0, account)
    squares, samples = np.zeros(len(PHASE_NAMES)), np.zeros(len(PHASE_NAMES))
    for j, trial in enumerate(account.fit.trials):
        inside = trial.phase >= 0
        change = account.fit.force_mn(j) - without.fit.force_mn(j)
        squares += np.bincount(trial.phase[inside], (trial.counts * change**2)[inside], len(PHASE_NAMES))
        samples += np.bincount(trial.phase[inside], trial.counts[inside], len(PHASE_NAMES))
    explained = max(account.gain_over(nothing)[0], 1e-12)
    rms_mn = float(np.sqrt(np.max(squares / np.maximum(samples, 1.0))))
    return Nameless(account.gain_over(without)[0] / explained, rms_mn, without)


def remainder_of(account: Account, nothing: Account) -> Remainder:
    """Weigh what an account leaves, beside what its laws may leave as far as they are likely to be off.

    A shape is weighed as an effect is, by the noise that is left with it: a slow one would pass for noise. So would
    what wanders in contact alone; it is told by the parts of a trial out of contact.
    ``nothing`` is the account without effects, at any noise.
    """
    bare = nothing.at_noise(account.fit.noise)
    best = _common(account, bare)
    quick = account.quick()
    if quick is not account:
        # the shape is looked for where no slow noise is granted; what is left without it is the noise beside it
        beside = replace(account, fit=_without(account.fit, shape_left(quick).force_mn)).reweighed()
        best = max(best, _common(account, nothing.at_noise(beside.fit.noise)), key=lambda r: r.evidence)
    bursts = find_transients(account.fit)
    if bursts.evidence > best.evidence:
        explained = max(account.gain_over(nothing)[0], 0.0)
        best = replace(best, share=bursts.evidence / (bursts.evidence + explained))
    trend = find_trend(account.fit)
    if trend.significant and trend.evidence > best.evidence:
        explained = max(account.gain_over(nothing)[0], 0.0)
        best = replace(best, share=trend.evidence / (trend.evidence + explained))
    return replace(
        best, bursts=bursts, trend=trend, inexact=_off(account, bare), wander=_wander(account, nothing)
    )


def _wander(account: Account, nothing: Account) -> Wander:
    """Return what wanders in contact alone beside an account; ``nothing`` is the one without effects."""
    quiet = out_of_contact(account.fit)
    if quiet.gain <= ENOUGH_OWN:
        return Wander(quiet.gain, 0.0, 0.0)
    there = account.at_noise(quiet.noise)
    wander = max(account.gain_over(there)[0], 0.0)
    explained = max(there.gain_over(nothing.at_noise(quiet.noise))[0], 0.0)
    return Wander(quiet.gain, wander / max(wander + explained, 1e-12), quiet.wander_mn)


def _off(account: Account, bare: Account) -> float:
    """Return what part of the evidence over a bare account comes of granting that laws are off, all by one noise."""
    if not account.inexact.by_effect:
        return 0.0
    in_form = (account.exact, account.exact.inexact_to(account.inexact.of_sizes))
    of_granting = min(account.gain_over(a.at_noise(account.fit.noise))[0] for a in in_form)
    return max(of_granting, 0.0) / max(account.gain_over(bare)[0], 1e-12)


def find_transients(fit: StudyFit) -> Bursts:
    """Return what there is more evidence for: bursts of milliseconds, or single samples."""
    return max(find_bursts(fit), find_outliers(fit), key=lambda b: b.evidence)


def shape_left(account: Account) -> CommonShape:
    """Return the shape that all trials have in common beside an account, its laws as far off as is likely."""
    known = account.as_off
    return common_shape(account.fit, known.columns, known.precision)


def unexpected(account: Account) -> StudyFit:
    """Return an account's fit, its laws where they stand, to what they are not likely to leave in all trials alike.

    What is theirs is no evidence for another; its estimate is the posterior mean.
    """
    known = account.as_off
    if not known.may_be_off:
        return account.fit
    grams, laws = known.grams, len(vector(known.fit.shared))
    free = [*range(TISSUE_SIZE), *range(TISSUE_SIZE + laws, TISSUE_SIZE + grams.n_added)]
    theirs = solve(grams.total(), grams.ridge, free)[0][TISSUE_SIZE:]
    forces_mn = (known.columns(j)[:, laws:] @ theirs for j in range(len(account.fit.trials)))
    return _without(account.fit, forces_mn).with_population(1)


def _without(fit: StudyFit, forces_mn: Iterable[FloatArray]) -> StudyFit:
    """Return the fit to trials from whose force something was taken, (n_j,) mN each."""
    trials = []
    for trial, force in zip(fit.trials, forces_mn, strict=True):
        full = trial.full_force_mn - trial.at_samples(force)
        trials.append(replace(trial, force_mn=trial.force_mn - force, full_force_mn=full.astype(np.float32)))
    return replace(fit, trials=tuple(trials))


def _common(account: Account, bare: Account) -> Remainder:
    """Weigh the remainder by a bare account's noise: its gain over the account, by this noise or the account's own."""
    same = bare.fit.noise == account.fit.noise
    here = account if same else account.at_noise(bare.fit.noise)
    left = shape_left(here).gain
    own = own_evidence(unexpected(here))[0]
    explained = max(here.gain_over(bare)[0], 0.0)
    # what the other noise gains by itself is nothing left over
    lost = min(here.gain_over(account)[0], 0.0)
    beyond = max(left, own, 0.0)
    return Remainder(left + lost, own + lost, beyond / max(beyond + explained, 1e-12), NO_BURSTS)
