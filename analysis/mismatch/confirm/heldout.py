"""Confirmation on trials that were not fitted: how far recordings are off before and after, against their noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.heldout import heldout_deviance
from analysis.mismatch.evidence.signflip import flip_test
from analysis.mismatch.fit.gram import solve
from analysis.mismatch.levels import FEWEST_HELD_OUT
from analysis.mismatch.model.effects import TISSUE_SIZE

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class HeldOut:
    """Mean square residual (n,) mN^2 of every trial before and after; noise floor (mN); p of the improvement."""

    scheme: str
    baseline_ms: FloatArray
    improved_ms: FloatArray
    floor_mn: float
    p_value: float


def confirm(baseline: Account, improved: Account, rng: np.random.Generator) -> HeldOut:
    """Predict every trial with what the others say of the laws, its own tissue fitted.

    H0 of the p-value: a trial is as likely predicted better as worse; sign-flips of whole trials' evidence.
    """
    before = _mean_squares(baseline)
    after = _mean_squares(improved) if improved.names else before
    chi2 = whitened_chi2(improved if improved.names else baseline)
    # what lies above the noise at rest is no noise: the floor is what a residual of chi2 1 would have
    floor = float(np.sqrt(np.mean(after) / max(chi2, 1.0)))
    gain = improved.evidence - baseline.evidence
    p = flip_test(gain[:, None], np.ones(1, dtype=bool), rng).p_value[0] if improved.names else 1.0
    scheme = (
        "every trial predicted by the sizes that the other trials give the mechanisms, its own tissue fitted"
        if len(before) >= FEWEST_HELD_OUT
        else "too few trials to hold any out"
    )
    return HeldOut(scheme, before, after, floor, float(p))


def whitened_chi2(account: Account) -> float:
    """Return chi2 a cell against the noise that was measured at rest."""
    fit = account.fit
    squares, freedom = 0.0, 0.0
    for j, whitener in enumerate(fit.whiteners):
        r = whitener(fit.residual_mn(j))
        squares += float(r @ r)
        freedom += len(r) - len(fit.own[j].tissue_and_free)
    return squares / max(freedom, 1.0)


def _mean_squares(account: Account) -> FloatArray:
    fit = account.fit
    pick = range(account.grams.n_added)
    held = heldout_deviance(account.grams, pick)
    b = solve(account.grams.total(), account.grams.ridge, range(TISSUE_SIZE + account.grams.n_added))[0]
    found = np.zeros(len(fit.trials))
    for j, (trial, G) in enumerate(zip(fit.trials, account.grams.by_trial, strict=True)):
        inside = np.repeat(trial.fitted, trial.counts.astype(int))
        r = fit.full_residual_mn(j)[inside]
        p = slice(0, len(b))
        fitted = float(G[-1, -1] - 2.0 * b @ G[p, -1] + b @ G[p, p] @ b)
        lost = max(float(held[j]) - fitted, 0.0) * fit.noise.white_mn**2
        found[j] = (float(r @ r) + lost) / max(len(r), 1)
    return cast(FloatArray, found)
