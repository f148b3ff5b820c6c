"""Whether an effect is itself: more than noise, more than what others are off by, and what the textbook says."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.shares import even_shares
from analysis.mismatch.fit.baseline import noise_left
from analysis.mismatch.fit.law_fit import fit_laws, law_prior, with_value
from analysis.mismatch.fit.noise import FASTEST_SLOW_S
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import (
    ENOUGH_SHARED,
    FEWEST_HELD_OUT,
    INEXACT,
    KEPT,
    ROUGH,
    SMALL_SHARE,
)
from analysis.mismatch.model.dictionary import templates
from analysis.mismatch.model.effects import Law
from analysis.simulation.mechanism import Parameter, library

OTHER_SIZES = (2.0**0.5, 0.5**0.5)
"""Times its size, where a law in its textbook's form is looked for besides: an event's own slope reaches one cell."""


def in_smooth_noise(account: Account) -> Account:
    """Return the account beside noise that went through two filters, or within a band, if it then predicts better.

    Beside such noise what comes and goes smoothly hardly shows: it is looked for without, and then asked whether it is
    more than that.
    """
    noise = noise_left(account.fit, may_be_smooth=True)
    return max(account, account.at_noise(noise), key=lambda a: a.nats) if noise.smooth else account


def beside_quick_noise(account: Account, of: Account) -> Account:
    """Return the account beside the quick part of another's noise, if it then predicts better.

    Slow noise of another kind than what an effect was found beside may be that effect.
    """
    noise = of.fit.noise.quicker_than(FASTEST_SLOW_S) + account.fit.noise.slower_from(FASTEST_SLOW_S)
    return max(account, account.at_noise(noise), key=lambda a: a.nats)


def is_off(account: Account, name: str, gain: float) -> bool:
    """Return whether an effect is off by a third or more, and a tenth of what it gains is that.

    By so much it is another law. All others are as far off as they are with it; where all are likelier exact none is.
    """
    return any(account.gain_over(right)[0] > SMALL_SHARE * gain for right in _were_it_right(account, name))


def _were_it_right(account: Account, name: str) -> Iterator[Account]:
    """Yield the account with an effect exact in form if it is off by a third where it explains most, and with one size
    in all trials if that differs by a third.
    """
    shares = account.inexact
    if name in account.may_be_off and shares.by_effect:
        most = int(np.argmax(account.explained_by_phase[account.may_be_off.index(name)]))
        if np.isclose(shares.of([name])[0, most], ROUGH):
            taken_as_exact = account.taken_as_exact | {name}
            yield replace(account.exact, taken_as_exact=taken_as_exact).inexact_to(shares)
    if np.isclose(shares.sizes.get(name, 0.0), ROUGH):
        sizes = {other: share for other, share in shares.sizes.items() if other != name}
        yield account.inexact_to(replace(shares, sizes=sizes))


def explains_itself(account: Account, before: Account, gain: float, asked: float) -> bool:
    """Return whether what an account gains over the one before is not just what laws may be off by.

    Those before it are granted to be as much off without it as with it. The first is to be nearly right itself. Others
    may be off, too, or be exact: what is granted to a weak one costs more than it brings.
    """
    if not before.may_be_off or len(account.fit.trials) < FEWEST_HELD_OUT:
        return gain - max(account.granted - before.granted, 0.0) >= KEPT * gain
    tenth = even_shares(account.may_be_off, INEXACT)
    shares = account.rough.inexact.or_larger(before.rough.inexact)
    added = frozenset(account.may_be_off) - frozenset(before.may_be_off)
    shares = shares.no_more_than(tenth, added)
    without = before.rough.inexact_to(shares)
    if account.rough.inexact_to(shares).gain_over(without)[0] >= asked:
        return True
    exact = replace(account.rough, taken_as_exact=added)
    return bool(added) and exact.inexact_to(shares).gain_over(without)[0] >= asked


def frees(account: Account, before: Account) -> bool:
    """Return whether laws that were granted to be off are exact with what was added: they were off for want of it.

    What laws leave by being off themselves no other takes up to the last: it would have to be all that they leave.
    """
    return before.granted > 0.0 and account.granted <= SMALL_SHARE * before.granted


def mends(account: Account, before: Account, nothing: Account, gain: float) -> bool:
    """Return whether an effect makes laws less off that would have to be off by more than what is named may be.

    Beside an effect that leaves them as they are nothing would be named, unless it gains more than they are off by.
    """
    if before.granted <= max(SMALL_SHARE * before.gain_over(nothing)[0], gain):
        return True
    return account.granted <= before.granted - ENOUGH_SHARED


def brings_itself(account: Account, name: str) -> bool:
    """Return whether an effect gains what it does nearly as the textbook has it: half without what it may do besides.

    A drop of a fifth of a millinewton and much that goes on after it is no slip, and what rings long after an arm is
    struck is no arm's mass. What has no name has no textbook either.
    """
    exact = account.exact
    if name not in library() or as_textbook(exact.fit, name) is exact.fit:
        return True
    nothing, whole = (fit_laws(fit).cost for fit in (exact.stripped(name).fit, exact.fit))
    asked = KEPT * (nothing - whole)
    # two of its inner parameters may make up for each other: drawn back one by one they are worse than as they were
    near, own = (as_textbook(exact.fit, name, most=most) for most in (1.0, 0.0))
    forms = (near,) if own.shared == near.shared else (near, own)
    return any(nothing - fit_laws(fit).cost >= asked for form in forms for fit in of_sizes(form, name))


def of_sizes(fit: StudyFit, name: str) -> Iterator[StudyFit]:
    """Yield the fit, and then with one of its laws larger and smaller: to where an event is no slope leads."""
    yield fit
    for at, law in enumerate(fit.shared.laws):
        if law.name == name:
            sizes = (times * law.values[law.size.name] for times in OTHER_SIZES)
            shared = (with_value(fit.shared, at, law.size, law.size.to_fit(size)) for size in sizes)
            yield from (replace(fit, shared=s) for s in shared)


def as_textbook(fit: StudyFit, name: str, *, most: float = 1.0) -> StudyFit:
    """Return the fit with one of its effects nearly in a form of its textbook; itself where it does nothing besides.

    What differs from site to site is the skin's, in the textbook too. ``most`` is as in `near_textbook`.
    """
    forms = textbook_forms(fit, name)
    laws = tuple(near_textbook(law, forms, most=most) if law.name == name else law for law in fit.shared.laws)
    states = tuple(
        s.with_only([k for k, x in enumerate(s.shapes) if x.effect != name or not x.kind or x.is_number])
        for s in fit.states
    )
    same = all(new.values == old.values for new, old in zip(laws, fit.shared.laws, strict=True))
    if same and all(new is old for new, old in zip(states, fit.states, strict=True)):
        return fit
    return replace(fit, shared=replace(fit.shared, laws=laws), states=states)


def beside_textbook(account: Account) -> Account:
    """Return the account with its laws exact and in a textbook's form, all else refitted; itself where they are.

    What a law is like is free again: there another law shows that it stands for where it is.
    """
    exact = account.exact
    laws = exact.fit.shared.laws
    fixed = tuple(
        near_textbook(law, textbook_forms(exact.fit, law.name), most=0.0) if law.name in library() else law
        for law in laws
    )
    if all(new.values == old.values for new, old in zip(fixed, laws, strict=True)):
        return exact
    fit = fit_laws(replace(exact.fit, shared=replace(exact.fit.shared, laws=fixed)))
    free = (replace(law, free=old.free) for law, old in zip(fit.shared.laws, laws, strict=True))
    return replace(exact, fit=replace(fit, shared=replace(fit.shared, laws=tuple(free))))


def textbook_forms(fit: StudyFit, name: str) -> list[Law]:
    """Return the forms in which the library has a law."""
    return [t.as_law(1.0) for t in templates(fit.trials) if t.name == name]


def near_textbook(law: Law, forms: Sequence[Law], *, most: float = 1.0) -> Law:
    """Return the law with its inner parameters near those of the nearest of a textbook's forms, where they stay.

    ``forms`` are those in which the library has the law, ``most`` how many standard deviations of what was expected
    they may be away.
    """
    known = law_prior([law])[0]
    inner = [(p, float(of_it)) for p, of_it in zip(law.parameters, known, strict=False) if p.inner]

    def away(form: Law, p: Parameter, of_it: float) -> float:
        return float((p.to_fit(law.values[p.name]) - p.to_fit(form.values[p.name])) * np.sqrt(of_it))

    nearest = min(forms, key=lambda form: sum(away(form, p, of_it) ** 2 for p, of_it in inner))
    values = dict(law.values)
    for p, of_it in inner:
        far = away(nearest, p, of_it)
        if abs(far) > most:
            values[p.name] = p.from_fit(
                p.to_fit(nearest.values[p.name]) + most * float(np.sign(far) / np.sqrt(of_it))
            )
    fixed = {p.name for p, _ in inner}
    return replace(law, values=values, free=tuple(name for name in law.free if name not in fixed))
