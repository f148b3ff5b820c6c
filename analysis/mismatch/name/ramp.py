"""The textbook's step undone, where that is the baseline: the ramp took time, and the tissue relaxed in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.levels import ENOUGH_SHARED
from analysis.mismatch.name.finding import LOOKED_AT, Finding
from analysis.simulation.mechanism import library

NAME = "finite_ramp"


def undo_step(account: Account) -> tuple[Account, tuple[Finding, ...]]:
    """Return the account driven by the recorded motion and that as a finding, if it explains the holds better."""
    if not account.fit.shared.ideal_step:
        return account, ()
    fit = replace(account.fit, shared=replace(account.fit.shared, ideal_step=False))
    ramp = Account(fit.with_population())
    anew = ramp.reweighed()
    gain, _ = anew.gain_over(account)
    if gain < ENOUGH_SHARED:
        return account, ()
    p = min(1.0, LOOKED_AT * float(np.exp(-min(gain, 700.0))))
    return anew, (Finding(library()[NAME], gain, p, {}, 1.0, {}),)
