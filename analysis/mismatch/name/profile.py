"""How likely all values are of what trades with the tissue: the time or the size of a law by which that relaxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.levels import FEWEST_HELD_OUT, SURE
from analysis.mismatch.model.effects import Law
from analysis.simulation.mechanism import Parameter

FloatArray = NDArray[np.float64]

AWAY = tuple(np.log([0.25, 0.35, 0.5, 0.7, 0.85, 1.0, 1.2, 1.4, 2.0, 2.8, 4.0]).tolist())
"""How far from where it was fitted, in its logarithm, a parameter is held."""


@dataclass(frozen=True)
class HeldAt:
    """An account in which a parameter of the law at a place is held, so far (in its logarithm) from where it was."""

    account: Account
    at: int
    away: float

    @property
    def nats(self) -> float:
        """The evidence; what other parameters leave open is integrated out."""
        return self.account.nats

    @property
    def law(self) -> Law:
        """The law as it is there."""
        return self.account.fit.shared.laws[self.at]


def traded(law: Law) -> Parameter | None:
    """Return what of a law trades with the arms of a tissue: its time, or its size where it has none; else None."""
    if not law.mechanism.relaxes or not law.of_site:
        return None
    return next((p for p in law.of_site if p.scale == "log"), law.size)


def at_likeliest(account: Account) -> tuple[Account, dict[str, dict[str, float]]]:
    """Return the account with its relaxing laws where they are likeliest, and their parameters' errors, by law.

    A law that tissues can stand for, fitted together with all of them, ends where both are likeliest and not where it
    is; nor does its curvature there tell how far it may be from that. It is held at one value after the other, and the
    evidence compared, in which all that is a trial's own is integrated out. It ends in the middle of what is likely:
    where the trials leave it open the likeliest is anywhere. Noise stays, and what laws are off by.
    """
    errors = {}
    for at, law in enumerate(account.fit.shared.laws):
        p = traded(law)
        if p is None or len(account.fit.trials) < FEWEST_HELD_OUT:
            continue
        profile = [held(account, at, p, away) for away in AWAY if _inside(p, law, away)]
        best = max(profile, key=lambda h: h.nats)
        middle = held(account, at, p, float(likely(profile) @ [h.away for h in profile]))
        # between two that are likely by themselves none need be
        best = middle if middle.nats > best.nats - SURE else best
        errors[law.name] = spread(best, profile)
        account = released(best, law.free, account)
    return account, errors


def _inside(p: Parameter, law: Law, away: float) -> bool:
    return p.lower < law.values[p.name] * float(np.exp(away)) < p.upper


def held(account: Account, at: int, p: Parameter, away: float) -> HeldAt:
    """Return the account refitted with a law's parameter held at so many times its value (as a logarithm)."""
    laws = list(account.fit.shared.laws)
    law = laws[at]
    values = {**law.values, p.name: law.values[p.name] * float(np.exp(away))}
    laws[at] = replace(law, values=values, free=tuple(name for name in law.free if name != p.name))
    there = account.exact.with_laws(tuple(laws))
    return HeldAt(there.inexact_to(account.inexact) if account.inexact else there, at, away)


def released(best: HeldAt, free: tuple[str, ...], account: Account) -> Account:
    """Return the account where a parameter was held, that free again."""
    laws = list(best.account.fit.shared.laws)
    laws[best.at] = replace(best.law, free=free)
    fit = replace(best.account.fit, shared=replace(best.account.fit.shared, laws=tuple(laws)))
    return replace(best.account, fit=fit, granted=account.granted)


def likely(profile: Sequence[HeldAt]) -> FloatArray:
    """Return how likely each of the values held is (K,), all being alike in their logarithm beforehand."""
    nats = np.array([h.nats for h in profile])
    steps = np.gradient([h.away for h in profile]) if len(profile) > 1 else np.ones(1)
    weights = np.exp(nats - nats.max()) * steps
    return np.asarray(weights / weights.sum())


def spread(best: HeldAt, profile: Sequence[HeldAt]) -> dict[str, float]:
    """Return how far (rms) each of a law's parameters is from where it is held best, over all that are likely."""
    weights = likely(profile)
    return {
        name: float(np.sqrt(weights @ np.array([h.law.values[name] - value for h in profile]) ** 2))
        for name, value in best.law.values.items()
    }
