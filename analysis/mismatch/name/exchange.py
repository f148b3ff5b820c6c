"""An effect that has a name in place of one that has none and stood for it while something was missing."""

from __future__ import annotations

from dataclasses import replace

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.name.rivals import Named, Rival
from analysis.mismatch.name.weighing import considered
from analysis.simulation.mechanism import library


def named_for_nameless(named: Named, newest: str, start: Account) -> Named:
    """Return what was named, with a rival that has a name in place of what has none, if that predicts as well.

    While the newest effect was missing, what can stand for anything explained more than its rivals did. ``start`` is
    the account without effects.
    """
    account = named.account
    for name in account.names:
        rivals = [r.name for r in named.rivals.get(name, ()) if r.name in library()]
        among = [rival for rival in rivals if rival not in account.names]
        if name == newest or name in library() or not among:
            continue
        others = account.without(name).settled()
        instead = considered(others, start, {}, among)
        if not instead:
            continue
        best = replace(instead[0], account=instead[0].settled_account())
        whole = Rival("", *account.gain_over(others), account)
        if best.as_good_as(whole) and not best.is_another:
            return Named(best.account, named.rivals | {best.name: (best, *instead[1:])}, {})
    return named
