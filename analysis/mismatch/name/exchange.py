"""One effect in place of others that stood for it while something was missing, if that predicts as well."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from itertools import combinations

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.name.pruning import pruned
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


def one_for_two(named: Named, start: Account) -> Named:
    """Return what was named, with one law in place of two of its stage, if that predicts as well.

    While another effect is missing a law may not be itself, and two are in its place. Where a third does for both, one
    of the two may alone do better.
    """
    account = named.account
    laws = account.fit.shared.laws if len(account.names) > 2 else ()
    for first, second in combinations(laws, 2):
        stage = first.mechanism.stage
        laws_alike = (m.name for m in library().values() if m.form == "law" and m.stage == stage)
        alike = [name for name in laws_alike if name not in account.names]
        if second.mechanism.stage != stage or not alike:
            continue
        others = account.stripped(first.name).without(second.name).settled()
        instead = _as_good(account, others, start, alike)
        if instead:
            ones = [instead[0]]
            for law, other in ((first, second), (second, first)):
                alone = account.without(other.name).settled()
                ones.append(Rival(law.name, *alone.gain_over(others), alone))
            best = max(ones, key=lambda r: r.account.nats)
            besides = (r for r in instead if r.name != best.name)
            # what made up for what two had too much of may be needless beside one
            there, adds = pruned(best.account, best, start)
            return Named(there, named.rivals | {best.name: (best, *besides)}, adds)
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
