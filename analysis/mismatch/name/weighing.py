"""What each effect that might be added to an account gains: refitted, by itself, beyond what others leave over."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.itself import brings_itself, explains_itself, frees, mends
from analysis.mismatch.evidence.left_over import LeftOver, left_over
from analysis.mismatch.levels import (
    CLOSE,
    ENOUGH_ONCE,
    ENOUGH_OWN,
    ENOUGH_SHARED,
    FEWEST_HELD_OUT,
    KEPT,
    SURE,
)
from analysis.mismatch.locate.remainder import shape_left
from analysis.mismatch.name.law_sizes import size_is_told
from analysis.mismatch.name.options import added, begun_again
from analysis.mismatch.name.oscillations import NAMELESS
from analysis.mismatch.name.own_sizes import own_sizes
from analysis.mismatch.name.phases import ahead_alike, phases_alike, stops_at_rest
from analysis.mismatch.name.rivals import Rival, as_they_stand, best_first
from analysis.mismatch.name.tries import worth_trying
from analysis.simulation.mechanism import library


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
    """Return the effects that have enough evidence to be added, refitted; only those ``among`` given names.

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
    if beyond < enough or gain < may_be_left or (anew and stands_for_shape(refitted, account, gain)):
        return []
    told = all(size_is_told(refitted, law) for law in refitted.fit.shared.laws if law.name == name)
    if not told or not brings_itself(refitted, name):
        return []
    itself = freed or explains_itself(refitted, account, gain, asked)
    off = refitted.granted / max(refitted.gain_over(nothing)[0], 1e-12)
    return [Rival(name, gain, error, refitted.let_go(), may_be_left / SURE, off, itself)]


def enough_for(name: str, account: Account) -> float:
    """Return the nats that an effect of an account is to gain: those of a law, or of what comes in each trial anew."""
    return ENOUGH_OWN if name in account.steps else ENOUGH_SHARED


def explained_beside(account: Account, name: str, nothing: Account) -> bool:
    """Return whether an effect is in an account and explains itself there, as one that is added to the others would."""
    if name not in account.names:
        return False
    without = account.without(name).reweighed()
    left = left_over(without, without.gain_over(nothing)[0], {})
    enough = enough_for(name, account)
    return any(r.itself for r in as_rival(name, account, without, nothing, enough, left))


def stands_for_shape(account: Account, without: Account, gain: float) -> bool:
    """Return whether too little of what comes in each trial anew is its own: a shape that all share gains the rest.

    A rhythm is in every trial at another of its moments, a step at another time: they leave nothing in common. What
    they don't take of a shape is another effect's.
    """
    least = (1.0 - KEPT) * gain
    left = shape_left(without).gain
    return left > least and left - max(shape_left(account).gain, 0.0) > least


def is_nothing(account: Account, name: str) -> bool:
    """Return whether an effect of an account is nothing: a law of no size, what no trial has, or no rhythm."""
    fit = account.fit
    if any(law.is_nothing for law in fit.shared.laws if law.name == name):
        return True
    bands = [r for s in fit.states for r in s.rhythms if r.effect == name]
    in_no_trial = not bands and not any(s.shapes.of(name) for s in fit.states)
    if any(r.is_nothing for r in bands) or (name in account.steps and in_no_trial):
        return True
    oscillations = {NAMELESS, *(m.name for m in library().values() if m.form == "oscillation")}
    rhythms = oscillations.intersection(account.steps)
    return name in rhythms and _is_no_rhythm(account, name, rhythms)


def _is_no_rhythm(account: Account, name: str, rhythms: Collection[str]) -> bool:
    """Return whether one of an account's rhythms is none: it goes with another's overtone, shows no more than is
    unsure, begins at one phase in all trials, or comes with motion. Of what has no name only the first can be said.
    """
    fit = account.fit
    if any(ahead_alike(fit, name, slower) > ENOUGH_ONCE for slower in rhythms):
        return True
    if name == NAMELESS:
        return False
    if phases_alike(fit, name) > ENOUGH_ONCE or stops_at_rest(fit, name):
        return True
    is_band = any(r.effect == name for s in fit.states for r in s.rhythms)
    mechanism = library()[name]
    return not is_band and not own_sizes(account, mechanism)[mechanism.amplitude].value > 0.0
