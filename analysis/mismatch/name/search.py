"""Search for the set of effects that predicts the recordings best: add, refit, weigh again, drop what is needless."""

from __future__ import annotations

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.itself import beside_quick_noise, in_smooth_noise
from analysis.mismatch.levels import ENOUGH_SHARED, MOST_EFFECTS
from analysis.mismatch.name.exchange import named_for_nameless
from analysis.mismatch.name.options import begun_again
from analysis.mismatch.name.profile import at_likeliest
from analysis.mismatch.name.pruning import pruned
from analysis.mismatch.name.rivals import Named, Rival, instead, told_apart
from analysis.mismatch.name.weighing import enough_for, explained_beside, ranked, weighed
from analysis.simulation.mechanism import library


def search(account: Account) -> Named:
    """Add the effect with most evidence, refit, drop what became needless, until nothing more is worth it."""
    start = account
    named = stands = Named(account, {}, {})
    while len(named.account.names) < MOST_EFFECTS:
        before = named
        step, lead = next_step(before, start)
        if not step:
            break
        best = step[0]
        nameless = [name for name in (best.name, *before.account.names) if name not in library()]
        if best.name in nameless and len(nameless) > 1:
            # a second shape says no more than the first: that something is there
            break
        rivals = before.rivals | ({lead.name: (lead,)} if lead else {})
        rivals = {name: instead(others, step) for name, others in rivals.items()} | {best.name: step}
        account, adds = pruned(begun_again(best.settled_account(), best.name, start), best, start)
        named = named_for_nameless(Named(account, rivals, adds), best.name, start)
        account, nats = named.account, before.account.nats
        needless = account.nats < nats + (0.0 if best.name in account.names else ENOUGH_SHARED)
        if needless and account.nats > nats and before is stands:
            stands = named
        if needless or (lead and not explained_beside(account, lead.name, start)):
            # nor is what led to it itself beside that
            break
        if is_more_than_noise(account, stands.account):
            stands = named
        elif before is not stands:
            # nor is it with one more beside it
            break
    # what was considered later says who stood in an effect's place by chance, also where nothing of it was taken
    found = {name: named.rivals[name] for name in stands.account.names}
    account, errors = at_likeliest(in_smooth_noise(told_apart(stands.account, found)))
    return Named(account, found, stands.adds, errors)


def is_more_than_noise(account: Account, before: Account) -> bool:
    """Return whether what was added to an account gains enough over nothing in smooth noise.

    What comes in each trial anew is to be more beside the quick part of that: the slow part stands for it, and is kept
    from it. For a law, which all trials share, no noise stands, and what else is slow may be noise beside it, too.
    """
    smooth = in_smooth_noise(before)
    added = [name for name in account.names if name not in before.names]
    if smooth is before:
        return True
    there = beside_quick_noise(account, smooth).nats
    if not any(name in account.steps for name in added):
        there = max(there, in_smooth_noise(account).nats)
    return there >= smooth.nats + sum(enough_for(name, account) for name in added)


def next_step(named: Named, nothing: Account) -> tuple[tuple[Rival, ...], Rival | None]:
    """Return the effects worth adding to what was named, best first, and what leads to them where they stand beside it.

    Where nothing is named and no effect explains itself, none of them is there, or each is bent by another that is
    missing. What gains most may lead to that other; whether it then explains itself is to be asked of both.
    """
    account = named.account
    found = weighed(account, nothing, named.adds)
    step = ranked(found, account)
    if step or not found or account.names:
        return step, None
    lead = max(found, key=lambda r: r.gain)
    beside = lead.settled_account()
    return ranked(weighed(beside, nothing, {lead.name: lead.gain}), beside), lead
