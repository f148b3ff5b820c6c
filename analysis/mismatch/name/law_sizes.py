"""How large a law is, and how well that is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.gram import solve
from analysis.mismatch.fit.law_fit import at_ends
from analysis.mismatch.levels import FEWEST_HELD_OUT, TWO_ERRORS
from analysis.mismatch.model.effects import TISSUE_SIZE, Law
from analysis.mismatch.name.own_sizes import SIZE_INEXACT, Quantity


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
    """Return the account with its laws off by as much at least as no size is better known than; itself if they are.

    Recordings may say that laws leave nothing over, but not of what their parameters could take up.
    """
    return account if account.inexact >= SIZE_INEXACT else replace(account, inexact=SIZE_INEXACT)


def law_sizes(account: Account, law: Law) -> dict[str, Quantity]:
    """Return a law's reported parameters with their errors, tissue and inexactness free.

    Laws are off in every phase as in the account, `loosened`, and parameters that trade with each other as unsure as
    that leaves them. What a law is like within stays where it ended at a limit: beyond it nothing trades with the size.
    """
    account = loosened(account)
    fit = account.fit
    N, ridge = account.grams.total(), account.grams.ridge
    parameters = [(p, other.values[p.name]) for other in fit.shared.laws for p in other.parameters]
    held = {TISSUE_SIZE + k for k, (p, value) in enumerate(parameters) if p.inner and any(at_ends(p, value))}
    pick = [k for k in range(TISSUE_SIZE + account.grams.n_added) if k not in held]
    errors = np.zeros(TISSUE_SIZE + account.grams.n_added)
    errors[pick] = np.sqrt(np.maximum(np.diag(solve(N, ridge, pick)[1]), 0.0))
    at = TISSUE_SIZE
    for other in fit.shared.laws:
        if other is law:
            break
        at += len(other.parameters)
    found = {}
    for k, p in enumerate(law.parameters):
        value = law.values[p.name]
        error = abs(p.derivative(value)) * float(errors[at + k])
        is_size = p.name == law.mechanism.amplitude and law.mechanism.null[p.name] == 0.0
        if is_size or (p.scale == "log" and p.name != law.mechanism.amplitude):
            # what is so much off in all phases alike, and a time by which they all go
            error = float(np.hypot(error, SIZE_INEXACT * value))
        if not p.inner:
            found[p.name] = Quantity(value, error, p.unit)
    return whole_law(law, found, fit.trials[0].study_depth_mm)


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
