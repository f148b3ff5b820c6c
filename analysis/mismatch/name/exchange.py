"""An effect that has a name in place of one that has none and stood for it while something was missing."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.name.rivals import Named, Rival
from analysis.mismatch.name.weighing import considered
from analysis.simulation.mechanism import library


def named_for_nameless(named: Named, newest: str, start: Account) -> Named:
    """Return what was named, with a rival that has a name in place of what has none, if that predicts as well.

    While the newest effect was missing, what can stand for anything explained more than its rivals did.
    """
    account = named.account
    for name in account.names:
        rivals = [r.name for r in named.rivals.get(name, ()) if r.name in library()]
        among = [rival for rival in rivals if rival not in account.names]
        if name == newest or name in library() or not among:
            continue
        instead = _as_good(account, account.without(name).settled(), start, among)
        if instead and not instead[0].is_another:
            one = instead[0]
            return Named(one.account, named.rivals | {one.name: instead}, {})
    return named


def _as_good(account: Account, others: Account, start: Account, among: Collection[str]) -> tuple[Rival, ...]:
    """Return what of some effects is worth adding to the others of an account, the best of them settled and first.

    Nothing, if that does not predict as well as the account. ``start`` is the one without effects.
    """
    step = considered(others, start, {}, among)
    if not step:
        return ()
    best = replace(step[0], account=step[0].settled_account())
    return (best, *step[1:]) if best.as_good_as(Rival("", *account.gain_over(others), account)) else ()
