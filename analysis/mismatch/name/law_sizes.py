"""How large a law is, and how well that is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.inexactness import law_effects
from analysis.mismatch.evidence.shares import even_shares
from analysis.mismatch.fit.gram import solve
from analysis.mismatch.fit.law_fit import at_ends, law_columns
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import FEWEST_HELD_OUT, TWO_ERRORS
from analysis.mismatch.model.effects import TISSUE_SIZE, Law
from analysis.mismatch.name.own_sizes import SIZE_INEXACT, Quantity

FloatArray = NDArray[np.float64]


def size_is_told(account: Account, law: Law) -> bool:
    """Return whether a law's size is more than two of its errors from nothing.

    What a tissue and its population took up for each other is evidence without a size. A form, as a power is, has none,
    and of one or two trials there is no population: what their one tissue may take up is as open as their sizes.
    """
    few = len(account.fit.trials) < FEWEST_HELD_OUT
    if few or law.size.name != law.mechanism.amplitude or law.size.scale != "linear":
        return True
    size = law_sizes(account, law)[law.size.name]
    return abs(size.value - law.mechanism.null[law.size.name]) > TWO_ERRORS * size.se


def loosened(account: Account) -> Account:
    """Return the account with its laws off by as much at least, in every phase, as no size is better known than.

    Recordings may say that laws leave nothing over, but not of what their parameters could take up.
    """
    least = even_shares(account.may_be_off, SIZE_INEXACT)
    return replace(account, inexact=account.inexact.or_larger(least))


def law_sizes(account: Account, law: Law) -> dict[str, Quantity]:
    """Return a law's reported parameters with their errors, tissue and inexactness free.

    Laws are off in every phase as in the account, `loosened`, and parameters that trade with each other as unsure as
    that leaves them; and all of a law by so much besides, in all phases alike. What a law is like within stays where it
    ended at a limit: beyond it nothing trades with the size.
    """
    account = loosened(account)
    fit = account.fit
    N, ridge = account.grams.total(), account.grams.ridge
    parameters = [(p, other.values[p.name]) for other in fit.shared.laws for p in other.parameters]
    held = {TISSUE_SIZE + k for k, (p, value) in enumerate(parameters) if p.inner and any(at_ends(p, value))}
    pick = [k for k in range(TISSUE_SIZE + account.grams.n_added) if k not in held]
    errors = np.zeros(TISSUE_SIZE + account.grams.n_added)
    errors[pick] = np.sqrt(np.maximum(np.diag(solve(N, ridge, pick)[1]), 0.0))
    at = fit.shared.laws.index(law)
    first = sum(len(other.parameters) for other in fit.shared.laws[:at])
    off = SIZE_INEXACT * steps_to_nothing(fit, at, slice(first, first + len(law.parameters)))
    found = {}
    for k, p in enumerate(law.parameters):
        value = law.values[p.name]
        error = abs(p.derivative(value)) * float(np.hypot(errors[TISSUE_SIZE + first + k], off[k]))
        if not p.inner:
            found[p.name] = Quantity(value, error, p.unit)
    return whole_law(law, found, fit.trials[0].study_depth_mm)


def steps_to_nothing(fit: StudyFit, at: int, columns: slice) -> FloatArray:
    """Return how far (P,) each parameter of a law is from where the law does nothing, on the scale of its fit.

    That is itself, less where it is nothing; or what changes as much force as the whole law (rms over all samples),
    where that is less: a level that cuts is so far from nothing as it cuts.
    """
    law, whole, per_step = fit.shared.laws[at], 0.0, np.zeros(columns.stop - columns.start)
    for j, (trial, state) in enumerate(zip(fit.trials, fit.states, strict=True)):
        whole += float(trial.counts @ law_effects(fit, j)[at] ** 2)
        per_step += trial.counts @ law_columns(trial, state, fit.shared)[:, columns] ** 2
    itself = [
        1.0 if p.scale == "log" else abs(law.values[p.name] - law.mechanism.null[p.name])
        for p in law.parameters
    ]
    shown = per_step > 0.0
    return np.where(shown, np.minimum(itself, np.sqrt(whole / np.where(shown, per_step, 1.0))), itself)


def whole_law(law: Law, found: dict[str, Quantity], depth_mm: float) -> dict[str, Quantity]:
    """Return sizes with those that a law's other form implies: d^p has the curvature of b at half the largest depth.

    Both forms grow alike there: 1 + b d / (1 + b d) = p.
    """
    p = found.get("exponent")
    if law.name != "stiffening" or p is None:
        return found
    bent = min(p.value - 1.0, 0.99)
    b = bent / (1.0 - bent) / (0.5 * depth_mm)
    slope = 1.0 / (1.0 - bent) ** 2 / (0.5 * depth_mm)
    return {"exponent": p, "coefficient_per_mm": Quantity(b, slope * p.se, "1/mm")}
