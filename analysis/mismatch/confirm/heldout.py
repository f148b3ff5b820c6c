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
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import FEWEST_HELD_OUT
from analysis.mismatch.locate.located import energies
from analysis.mismatch.locate.windows import window_columns
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
    floor_mn = noise_floor_mn((improved if improved.names else baseline).fit)
    gain = improved.evidence - baseline.evidence
    p = flip_test(gain[:, None], np.ones(1, dtype=bool), rng).p_value[0] if improved.names else 1.0
    scheme = (
        "every trial predicted by the sizes that the other trials give the mechanisms, its own tissue fitted"
        if len(before) >= FEWEST_HELD_OUT
        else "too few trials to hold any out"
    )
    return HeldOut(scheme, before, after, floor_mn, float(p))


def noise_floor_mn(fit: StudyFit) -> float:
    """Return the rms of a sample's residual (mN) less what of it lies beyond the noise that was measured at rest.

    Cells where things happen hold few samples: chi2 a cell would take what a short motion leaves for all of a trial's.
    """
    energy, _, samples = energies(fit, [window_columns(t) for t in fit.trials])
    beyond = float(energy.sum()) / max(float(samples.sum()), 1.0)
    squares = sum(float(r @ r) for r in (_fitted_residual_mn(fit, j) for j in range(len(fit.trials))))
    whole = squares / max(sum(float(t.counts @ t.fitted) for t in fit.trials), 1.0)
    return float(np.sqrt(max(whole - beyond, fit.noise.white_mn**2)))


def _fitted_residual_mn(fit: StudyFit, j: int) -> FloatArray:
    """Return what is left of every fitted sample of the j-th trial, mN."""
    trial = fit.trials[j]
    return fit.full_residual_mn(j)[np.repeat(trial.fitted, trial.counts.astype(int))]


def _mean_squares(account: Account) -> FloatArray:
    fit = account.fit
    pick = range(account.grams.n_added)
    held = heldout_deviance(account.grams, pick)
    b = solve(account.grams.total(), account.grams.ridge, range(TISSUE_SIZE + account.grams.n_added))[0]
    found = np.zeros(len(fit.trials))
    for j, G in enumerate(account.grams.by_trial):
        r = _fitted_residual_mn(fit, j)
        p = slice(0, len(b))
        fitted = float(G[-1, -1] - 2.0 * b @ G[p, -1] + b @ G[p, p] @ b)
        lost = max(float(held[j]) - fitted, 0.0) * fit.noise.white_mn**2
        found[j] = (float(r @ r) + lost) / max(len(r), 1)
    return cast(FloatArray, found)
