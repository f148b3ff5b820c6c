"""Search for the set of effects that predicts the recordings best: add, refit, weigh again, drop what is needless."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.itself import (
    beside_quick_noise,
    brings_itself,
    explains_itself,
    frees,
    in_smooth_noise,
    mends,
)
from analysis.mismatch.evidence.left_over import LeftOver, left_over
from analysis.mismatch.levels import (
    CLOSE,
    ENOUGH_ONCE,
    ENOUGH_OWN,
    ENOUGH_SHARED,
    FEWEST_HELD_OUT,
    INEXACT,
    KEPT,
    MOST_EFFECTS,
    SURE,
)
from analysis.mismatch.locate.remainder import shape_left
from analysis.mismatch.name.law_sizes import size_is_told
from analysis.mismatch.name.options import added, begun_again, better, own_options
from analysis.mismatch.name.oscillations import phases_alike
from analysis.mismatch.name.own_sizes import own_sizes
from analysis.mismatch.name.rivals import Rival, as_they_stand, best_first, instead, told_apart
from analysis.mismatch.name.tries import worth_trying
from analysis.simulation.mechanism import library


@dataclass(frozen=True)
class Named:
    """The account that predicts best, who was considered for each of its effects, by name, and what each adds.

    ``adds`` are the nats that are lost without an effect, where the search came to know them.
    """

    account: Account
    rivals: dict[str, tuple[Rival, ...]]
    adds: dict[str, float]


def search(account: Account) -> Named:
    """Add the effect with most evidence, refit, drop what became needless, until nothing more is worth it."""
    rivals: dict[str, tuple[Rival, ...]] = {}
    start, adds = account, dict[str, float]()
    stands, of_it = account, adds
    while len(account.names) < MOST_EFFECTS:
        before = account
        step, lead = next_step(account, start, adds)
        if not step:
            break
        rivals |= {lead.name: (lead,)} if lead else {}
        best = step[0]
        rivals = {name: instead(others, step) for name, others in rivals.items()} | {best.name: step}
        account, adds = pruned(begun_again(best.settled_account(), best.name, start), best, start)
        led = ENOUGH_SHARED if best.name not in account.names else 0.0
        needless = account.nats < before.nats + led
        if needless and account.nats > before.nats and before is stands:
            stands, of_it = account, adds
        # nor is what led to it itself beside that
        if needless or (lead and not explained_beside(account, lead.name, start)):
            break
        if is_more_than_noise(account, stands):
            stands, of_it = account, adds
        elif before is not stands:
            # nor is it with one more beside it
            break
    account, rivals, adds = one_for_two(stands, start, rivals, of_it)
    found = {name: rivals[name] for name in account.names}
    return Named(in_smooth_noise(told_apart(account, found)), found, adds)


def is_more_than_noise(account: Account, before: Account) -> bool:
    """Return whether what was added to an account gains enough over nothing in smooth noise."""
    smooth = in_smooth_noise(before)
    enough = sum(enough_for(name, account) for name in account.names if name not in before.names)
    return smooth is before or beside_quick_noise(account, smooth).nats >= smooth.nats + enough


def next_step(
    account: Account, nothing: Account, adds: Mapping[str, float]
) -> tuple[tuple[Rival, ...], Rival | None]:
    """Return the effects worth adding to an account, best first, and what leads to them, where they stand beside that.

    Where nothing is named and no effect explains itself, none of them is there, or each is bent by another that is
    missing. What gains most may lead to that other; whether it then explains itself is to be asked of both.
    """
    found = weighed(account, nothing, adds)
    step = ranked(found, account)
    if step or not found or account.names:
        return step, None
    lead = max(found, key=lambda r: r.gain)
    beside = lead.settled_account()
    return ranked(weighed(beside, nothing, {**adds, lead.name: lead.gain}), beside), lead


def explained_beside(account: Account, name: str, nothing: Account) -> bool:
    """Return whether an effect is in an account and explains itself there, as one that is added to the others would."""
    if name not in account.names:
        return False
    without = account.without(name).reweighed()
    left = left_over(without, without.gain_over(nothing)[0], {})
    enough = enough_for(name, account)
    return any(r.itself for r in as_rival(name, account, without, nothing, enough, left))


def enough_for(name: str, account: Account) -> float:
    """Return the nats that an effect of an account is to gain: those of a law, or of what comes in each trial anew."""
    return ENOUGH_OWN if name in account.steps else ENOUGH_SHARED


def one_for_two(
    account: Account, start: Account, rivals: dict[str, tuple[Rival, ...]], adds: dict[str, float]
) -> tuple[Account, dict[str, tuple[Rival, ...]], dict[str, float]]:
    """Return the account with one law in place of two of its stage, if that predicts as well, and who was considered.

    While another effect is missing a law may not be itself, and two are in its place. Where a third does for both, one
    of the two may alone do better.
    """
    laws = account.fit.shared.laws if len(account.names) > 2 else ()
    for first, second in combinations(laws, 2):
        stage = first.mechanism.stage
        laws_alike = (m.name for m in library().values() if m.form == "law" and m.stage == stage)
        alike = [name for name in laws_alike if name not in account.names]
        if second.mechanism.stage != stage or not alike:
            continue
        others = account.stripped(first.name).without(second.name).settled()
        step = considered(others, start, {}, alike)
        if not step:
            continue
        one = replace(step[0], account=step[0].settled_account())
        gain, error = account.gain_over(others)
        if one.as_good_as(Rival("", gain, error, account)):
            ones = [one]
            for law, other in ((first, second), (second, first)):
                alone = account.without(other.name).settled()
                ones.append(Rival(law.name, *alone.gain_over(others), alone))
            best = max(ones, key=lambda r: r.account.nats)
            besides = (r for r in step if r.name != best.name)
            return best.account, rivals | {best.name: (best, *besides)}, {}
    return account, rivals, adds


def considered(
    account: Account, nothing: Account, adds: Mapping[str, float], among: Collection[str] | None = None
) -> tuple[Rival, ...]:
    """Return the effects worth adding, by `weighed`, best first."""
    return ranked(weighed(account, nothing, adds, among), account)


def ranked(found: Sequence[Rival], account: Account) -> tuple[Rival, ...]:
    """Return those that explain themselves of the effects that were weighed, best first."""
    return best_first(as_they_stand([r for r in found if r.itself], account))


def weighed(
    account: Account, nothing: Account, adds: Mapping[str, float], among: Collection[str] | None = None
) -> list[Rival]:
    """Return the effects that have enough evidence to be added, refitted; of laws only those ``among`` given names.

    ``nothing`` is the account without effects, ``adds`` what each present effect explains, where that is known. What
    the present laws leave by being off names no other: an effect must gain as much where they are granted to be off,
    with it and without it. H0 is that what they leave besides is exponential about `left_over`.

    Each is weighed with the noise that itself leaves: an effect that was taken for noise would hide itself.
    """
    few = len(account.fit.trials) < FEWEST_HELD_OUT
    left = left_over(account, account.gain_over(nothing)[0], adds)
    tries = worth_trying(account, nothing, left, among)
    found: list[Rival] = []
    for name, options in tries.options.items():
        # refits cost most of the time: none is made that can't be a rival, however far the line misses
        best = max((r.gain for r in found if r.itself), default=0.0)
        if not few and name not in tries.taken_up and tries.largest[name] < CLOSE * best:
            continue
        refitted = added(options, account)
        # nor are its laws granted to be off, where no more than half of a gain may come of that, nor what is nothing
        little = not few and refitted.nats - account.of_exact_laws < KEPT * CLOSE * best
        if little or is_nothing(refitted, name):
            continue
        refitted = refitted.granting()
        if not is_nothing(refitted, name):
            found += as_rival(name, refitted, account, nothing, options[0].enough, left)
    return found


def as_rival(
    name: str, refitted: Account, account: Account, nothing: Account, enough: float, left: LeftOver
) -> list[Rival]:
    """Return what was added to an account and refitted as a rival, if it gains enough, and by itself; else none."""
    anew = name in refitted.steps
    gain, error = refitted.gain_over(account)
    if anew and refitted.granted - account.granted > (1.0 - KEPT) * gain:
        # fitted while it was missing, a law may stand for a part of it, and not find back
        for law in refitted.fit.shared.laws:
            refitted = begun_again(refitted, law.name, nothing)
        gain, error = refitted.gain_over(account)
    freed = frees(refitted, account) and gain >= enough
    before = account.exact.weighed_anew() if freed else account
    gain, error = refitted.gain_over(before)
    # a gain below its error is one trial's, at the cost of others
    asked = max(enough, error)
    if gain >= asked:
        gain, error = refitted.gain_by_itself(before)
    if gain >= asked and any(s.rhythms for s in account.fit.states):
        # a rhythm that was followed anew may be found elsewhere, whatever was added
        without = refitted.without(name).reweighed()
        if without.nats > account.nats:
            gain, error = refitted.gain_over(without)
    if gain < asked or not mends(refitted, account, nothing, gain):
        return []
    may_be_left, beyond = left.of(refitted, account, anew=anew)
    if beyond < enough or (anew and stands_for_shape(refitted, account, gain)):
        return []
    told = all(size_is_told(refitted, law) for law in refitted.fit.shared.laws if law.name == name)
    if not told or not brings_itself(refitted, name):
        return []
    itself, off = freed or explains_itself(refitted, account, gain, asked), refitted.granted_share(nothing)
    return [Rival(name, gain, error, refitted.let_go(), may_be_left / SURE, off, itself)]


def stands_for_shape(account: Account, without: Account, gain: float) -> bool:
    """Return whether too little of what comes in each trial anew is its own: a shape that all share gains the rest.

    A rhythm is in every trial at another of its moments, a step at another time: they leave nothing in common. What
    they don't take of a shape is another effect's.
    """
    least = (1.0 - KEPT) * gain
    left = shape_left(without).gain
    return left > least and left - max(shape_left(account).gain, 0.0) > least


def is_nothing(account: Account, name: str) -> bool:
    """Return whether an effect of an account is nothing: a law of no size, a band without a frequency, or a rhythm that
    shows no more than is unsure, or begins at one phase in all trials.
    """
    fit = account.fit
    if any(law.is_nothing for law in fit.shared.laws if law.name == name):
        return True
    bands = [r for s in fit.states for r in s.rhythms if r.effect == name]
    if any(r.is_nothing for r in bands):
        return True
    mechanism = library().get(name)
    if name not in account.steps or mechanism is None or mechanism.form != "oscillation":
        return False
    if phases_alike(fit, name) > ENOUGH_ONCE:
        return True
    return not bands and not own_sizes(account, mechanism)[mechanism.amplitude].value > 0.0


def pruned(account: Account, newest: Rival, nothing: Account) -> tuple[Account, dict[str, float]]:
    """Take out, one by one, what the newest effect and the others make needless; return what the others add, in nats.

    What comes in each trial anew is looked for once more, and laws are begun again: times and forms were found where
    the newest was still missing, and a law that stood for a part of it may not find back from there. ``nothing`` is the
    account without effects.
    The newest comes last: it may have done no more than lead the others to where they predict as well without it.
    What was added is not known where something was taken out since. An account without what explains much is not begun
    anew: that changes hardly a tenth of it.
    """
    adds = {newest.name: newest.gain}
    for name in (*(n for n in account.names if n != newest.name), newest.name):
        if len(account.names) < 2:
            break
        without, anew = account.without(name).reweighed(), name in account.steps
        enough = enough_for(name, account)
        if account.gain_over(without)[0] < enough / INEXACT:
            without = without.settled()
        # led astray by what is missing, the others may predict worse than nothing
        without = max(without, nothing, key=lambda a: a.nats)
        if name != newest.name and anew:
            account = better(account, own_options(without.quick(), name))
        elif name != newest.name:
            account = begun_again(account, name, nothing)
        adds[name] = account.gain_over(without)[0]
        needless = adds[name] < enough or is_nothing(account, name)
        if needless or (anew and stands_for_shape(account, without, adds[name])):
            account, adds = without, {}
    return account, adds
