"""What effects leave by being off, where they act, and what of another's gain may be that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.inexactness import inexact_effects
from analysis.mismatch.fit.study_fit import Held
from analysis.mismatch.levels import FEWEST_HELD_OUT, INEXACT, ROUGH, SURE, UNFORESEEN
from analysis.recordings.trial import PHASE_NAMES
from analysis.simulation.cells import CellTrial

FloatArray = NDArray[np.float64]

TINY = 1e-300


@dataclass(frozen=True)
class LeftOver:
    """Nats (P,) that an account's effects leave in every phase by being inexact: to a law, and to what comes anew."""

    to_laws: FloatArray
    to_others: FloatArray

    def of(self, account: Account, before: Account, *, anew: bool) -> tuple[float, float]:
        """Return how many of the nats by which an account leaves less than the one before may be what was left there
        by being inexact, and how many are beyond that.

        What is left in a phase is exponential about what is expected (H0), and once in twenty `SURE` times as much.
        """
        left = self.to_others if anew else self.to_laws
        if not left.any():
            return 0.0, np.inf
        gained = gained_where(account, before)
        may_be = float(np.minimum(np.maximum(gained, 0.0), SURE * left).sum())
        return may_be, float(gained.sum()) - may_be


def left_over(account: Account, explained: float, adds: Mapping[str, float]) -> LeftOver:
    """Return what an account's effects, which explain so many nats, leave by being inexact.

    Of few trials none can say how. Effects that are off by a third in what was foreseen are so in what was not. The
    band of a rhythm has no shapes for what it may do besides. It leaves something else in each of n trials: a law, the
    same in all, gains of that what it would in one of them.
    """
    n = len(account.fit.trials)
    if n < FEWEST_HELD_OUT:
        left = ROUGH**2 * explained * shares_of_all(acting(account, account.names))
        return LeftOver(left, left)
    rhythms = tuple({r.effect: None for s in account.fit.states for r in s.rhythms})
    own = min(sum(adds.get(name, explained) for name in rhythms), explained)
    names = account.may_be_off
    whole = float(acting(account, names).sum())
    # what is smooth tells by how much a law is off in that, but not that it is right in all else
    shares = np.maximum(account.as_off.inexact.of(names), INEXACT)
    unforeseen = acting(account, names, UNFORESEEN * shares).sum(axis=0) / max(whole, TINY)
    others = (explained - own) * unforeseen
    of_rhythms = INEXACT**2 * own * shares_of_all(acting(account, rhythms))
    return LeftOver(others + of_rhythms / n, others + of_rhythms)


def shares_of_all(acts: FloatArray) -> FloatArray:
    """Return what part of all that effects (E, P) explain lies in every phase (P,)."""
    return np.asarray(acts.sum(axis=0) / max(float(acts.sum()), TINY))


def acting(account: Account, names: Sequence[str], shares: FloatArray | None = None) -> FloatArray:
    """Return the chi2 (E, P) that some of an account's effects, or ``shares`` (E, P) of them, show in every phase.

    It is what tissue, contact and offset of each trial can't take up, wherever that is left: tissue that follows what
    bends a ramp leaves a part of it in the hold.
    """
    fit = account.exact.fit
    found = np.zeros((len(names), len(PHASE_NAMES)))
    if not names:
        return found
    whiteners = tuple(w.with_rhythms(()) for w in fit.whiteners)
    states = tuple(replace(s.with_only([]), rhythms=()) for s in fit.states)
    bare = replace(fit, whiteners=whiteners, states=states, held=Held())
    for j, (trial, projector) in enumerate(zip(fit.trials, bare.projectors, strict=True)):
        effects = np.column_stack(inexact_effects(fit, j, names))
        left = projector(effects if shares is None else effects * shares.T[trial.phase])
        found += by_phase(trial, left**2).T
    return found


def by_phase(trial: CellTrial, squares: FloatArray) -> FloatArray:
    """Return the sums (P, ...) over each phase of what a trial's fitted cells have (n, ...); some are in no phase."""
    phase = trial.phase[trial.fitted]
    return np.array([squares[phase == code].sum(axis=0) for code in range(len(PHASE_NAMES))])


def gained_where(account: Account, before: Account) -> FloatArray:
    """Return the nats (P,) by which an account leaves less than the one before in every phase, its laws as exact.

    Both are weighed by one noise, and what each trial's own parameters can take up is left out.
    """
    noise = account.fit.noise
    after, before = (
        a if a.fit.noise == noise and not a.inexact else a.exact.at_noise(noise) for a in (account, before)
    )
    left = []
    for each in (before, after):
        pairs = zip(each.fit.trials, each.fit.projectors, strict=True)
        left.append(np.sum([by_phase(t, p.residual**2) for t, p in pairs], axis=0))
    return np.asarray(0.5 * (left[0] - left[1]))
