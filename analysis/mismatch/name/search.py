"""Search for the set of effects that predicts the recordings best: add, refit, weigh again, drop what is needless."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from analysis.mismatch.evidence.account import Account, with_own_sizes
from analysis.mismatch.evidence.heldout import predictive_deviance
from analysis.mismatch.fit.gram import gram, solve
from analysis.mismatch.fit.law_fit import fit_laws
from analysis.mismatch.fit.settled import settled_columns
from analysis.mismatch.fit.study_fit import StudyFit
from analysis.mismatch.levels import (
    CLOSE,
    ENOUGH_OWN,
    ENOUGH_SHARED,
    FEWEST_HELD_OUT,
    INEXACT,
    KEPT,
    MOST_EFFECTS,
    REFITTED,
    ROUGH,
    STARTS,
)
from analysis.mismatch.model.dictionary import Template, templates
from analysis.mismatch.model.effects import TISSUE_SIZE
from analysis.mismatch.name.events import EventScan, scan_events, with_events
from analysis.mismatch.name.oscillations import OscillationScan, scan_oscillations, with_oscillation

NAMELESS = "oscillation"
"""An oscillation in no band of the library."""
TIMES_LOOKED_AT = 70
FIRST_ROUNDS = 5


@dataclass(frozen=True)
class Option:
    """An effect that might be added: name, linear evidence (nats), what is enough, how to refit it.

    ``beside`` is its evidence beside the law that has most.
    """

    name: str
    nats: float
    enough: float
    refit: Callable[[], Account]
    beside: float = 0.0


@dataclass(frozen=True)
class Rival:
    """An effect that was refitted at one step: evidence in nats over the account before, and its paired error.

    ``left`` are the nats that the laws before it leave over by being inexact.
    """

    name: str
    gain: float
    error: float
    account: Account
    left: float = 0.0


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
    while len(account.names) < MOST_EFFECTS:
        step = considered(account, start)
        if not step:
            break
        best = step[0]
        rivals[best.name] = step
        account, adds = pruned(begun_again(best.account.settled(), best.name, start), best)
    return Named(account, {name: rivals[name] for name in account.names}, adds)


def begun_again(account: Account, name: str, nothing: Account) -> Account:
    """Return the account with a law of several forms begun from each of them, if it then predicts better.

    Its form was chosen by a noise that the mismatch itself had made, and by a tissue bent by it.
    """
    if sum(t.name == name for t in templates(account.fit.trials)) < 2:
        return account
    options = law_options(account.exact.stripped(name), nothing)
    again = (o.refit().reweighed() for o in options if o.name == name)
    return max((account, *again), key=lambda a: float(a.evidence.sum()))


def considered(account: Account, nothing: Account) -> tuple[Rival, ...]:
    """Return the effects worth adding, refitted, best first; none where the best has not enough evidence.

    ``nothing`` is the account without effects: what the present laws gain over it they explain. Right to a tenth they
    leave a hundredth of that, right to a third a tenth, and what they leave names no other; a law with which they are
    right was missing. Where the recordings say that they are better than that, they leave less.

    Each is weighed with the noise that itself leaves: an effect that was taken for noise would hide itself.
    """
    explained = account.gain_over(nothing)[0]
    few = len(account.fit.trials) < FEWEST_HELD_OUT
    least = CLOSE * left_over(explained, account.most_inexact)
    listed = [law_options(account, nothing)]
    # what was taken for slow noise is found where none is granted; most of all what comes in each trial anew
    quick = account.quick()
    if quick is not account:
        listed.append(law_options(quick, nothing))
    listed.append(own_options(quick))
    worth = [worth_trying(some, least, few) for some in listed]
    options: dict[str, list[Option]] = {}
    for option in (option for some in worth for option in some):
        options.setdefault(option.name, []).append(option)
    largest = {name: max(p.nats for some in listed for p in some if p.name == name) for name in options}
    # a line drawn beside noise that took the mismatch up says little of how much there is
    taken_up = {option.name for option in worth[0]} if quick is not account else set()
    found: list[Rival] = []
    for name in sorted(options, key=lambda name: -largest[name]):
        # refits cost most of the time: none is made that can't be a rival, however far the line misses
        best = max((r.gain for r in found), default=0.0)
        if not few and name not in taken_up and largest[name] < CLOSE * best:
            continue
        # a wander of any size makes likely whatever is left: who explains something leaves less than there was
        most_mn = (1.0 + INEXACT) * account.fit.left_mn
        refits = ((option, option.refit().reweighed()) for option in options[name])
        fits = next(((o, r) for o, r in refits if r.fit.left_mn <= most_mn), None)
        if fits is None:
            continue
        option, refitted = fits
        if any(law.is_nothing for law in refitted.fit.shared.laws if law.name == name):
            continue
        gain, error = refitted.gain_over(account)
        # a gain below its error is one trial's, at the cost of others; of few trials none can say how exact a law is
        left = left_over(explained, ROUGH if few else max(refitted.inexact, INEXACT))
        if gain < left and not few:
            left = left_over(explained, refitted.most_inexact)
        # nor does an effect explain what it gains by granting that laws are off
        its_own = gain - max(refitted.granted - account.granted, 0.0)
        if gain >= max(option.enough, error, left) and its_own >= KEPT * gain:
            found.append(Rival(option.name, gain, error, refitted.let_go(), left))
    return tuple(sorted(found, key=lambda r: -r.gain))


def left_over(explained: float, inexact: float) -> float:
    """Return the nats that laws which explain so many leave to others by being inexact."""
    return inexact**2 * explained


def worth_trying(options: list[Option], least: float, few: bool) -> list[Option]:
    """Return the few effects with most linear evidence that have enough of it, half of which the line may miss.

    Beside them the one that says most that the best does not: several may be one and the same to a line. All that have
    enough where trials are ``few``: there much is far from linear, and a refit costs little.
    """
    best = sorted(options, key=lambda o: -o.nats)
    enough = [o for o in best if o.nats > max(0.5 * o.enough, least)]
    if few:
        return enough
    first = [o for o in enough if o.nats > CLOSE * best[0].nats][:REFITTED]
    others = [o for o in enough if o not in first and o.beside > max(0.5 * o.enough, least)]
    return first + sorted(others, key=lambda o: -o.beside)[:1]


def pruned(account: Account, newest: Rival) -> tuple[Account, dict[str, float]]:
    """Take out, one by one, what the newest effect and the others make needless; return what the others add, in nats.

    What comes in each trial anew is looked for once more: its times were found where the newest was still missing.
    What was added is not known where something was taken out since.
    """
    adds = {newest.name: newest.gain}
    for name in account.names:
        if name == newest.name:
            continue
        without = account.without(name).settled()
        if name in account.steps:
            anew = [o.refit().reweighed() for o in own_options(without.quick()) if o.name == name]
            account = max((account, *anew), key=lambda a: float(a.evidence.sum()))
        adds[name] = account.gain_over(without)[0]
        if adds[name] < (ENOUGH_OWN if name in account.steps else ENOUGH_SHARED):
            account, adds = without, {}
    return account, adds


def law_options(account: Account, nothing: Account) -> list[Option]:
    """Return the laws that might be added, weighed beside what the present laws may leave over."""
    fit = account.fit
    wanted = templates(fit.trials, account.names)
    # of fewer trials none can say how exact a law is
    inexact = account.inexact or (INEXACT if len(fit.trials) >= FEWEST_HELD_OUT else 0.0)
    known = replace(account, inexact=inexact)
    present = len(known.precision)
    columns = (np.hstack([known.columns(j), settled_columns(fit, j, wanted)]) for j in range(len(fit.trials)))
    grams = gram(fit, columns, np.append(known.precision, np.zeros(len(wanted))))
    before = predictive_deviance(grams, range(present))
    total = grams.total()

    def weighed(k: int, beside: tuple[int, ...] = ()) -> tuple[float, float]:
        """Return what a template gains, and its coefficient."""
        pick = [*range(TISSUE_SIZE + present), *(TISSUE_SIZE + present + b for b in (*beside, k))]
        coefficients = solve(total, grams.ridge, pick)[0]
        # as of a law that was refitted: a size is known to about itself, whatever the scale of these recordings
        ridge = grams.ridge.copy()
        ridge[pick[TISSUE_SIZE + present :]] = 1.0 / np.maximum(
            coefficients[TISSUE_SIZE + present :] ** 2, 1e-24
        )
        after = predictive_deviance(
            replace(grams, ridge=ridge), [*range(present), *(present + b for b in (*beside, k))]
        )
        if wanted[k].mechanism.one_sided and coefficients[-1] <= 0:
            return 0.0, float(coefficients[-1])
        return 0.5 * float((before - after).sum()), float(coefficients[-1])

    best: dict[str, list[tuple[float, int, float]]] = {}
    for k, template in enumerate(wanted):
        gain, coefficient = weighed(k)
        best.setdefault(template.name, []).append((gain, k, coefficient))
    options = []
    most, leader, _ = max((max(found) for found in best.values()), default=(0.0, 0, 0.0))
    for name, found in best.items():
        found.sort(reverse=True)
        beside = 0.0 if name == wanted[leader].name else weighed(found[0][1], (leader,))[0] - most
        starts = found[:1]
        for other in found[1:]:
            if len(starts) < STARTS and all(abs(other[1] - f[1]) >= len(found) / STARTS for f in starts):
                starts.append(other)
        refit = _law_refit(account, nothing, wanted, starts)
        options.append(Option(name, found[0][0], ENOUGH_SHARED, refit, beside))
    return options


def _law_refit(
    account: Account, nothing: Account, wanted: list[Template], starts: list[tuple[float, int, float]]
) -> Callable[[], Account]:
    def refit() -> Account:
        exact = account.exact
        fits = [
            replace(f, shared=replace(f.shared, laws=(*f.shared.laws, wanted[k].as_law(c))))
            for _, k, c in starts
            for f in (exact.fit, *_anew(account, nothing))
        ]
        # the population moves little: it is left alone until the best start is known
        refitted = [fit_laws(f, rounds=FIRST_ROUNDS) for f in fits]
        depth_mm = account.fit.trials[0].study_depth_mm
        hold = [
            f for f in refitted if all(law.mechanism.holds(law.values, depth_mm) for law in f.shared.laws)
        ]
        best = with_own_sizes(min(hold or refitted, key=lambda f: f.cost))
        return replace(exact, fit=best).with_laws(best.shared.laws)

    return refit


def _anew(account: Account, nothing: Account) -> list[StudyFit]:
    """Return from where a present law is refitted beside where it stands: of one or two trials, from the textbook.

    There nothing keeps the first law, and the trial's own parameters with it, from standing for one still missing.
    """
    fit = account.exact.fit
    if len(fit.trials) >= FEWEST_HELD_OUT or len(fit.shared.laws) != 1:
        return []
    start = nothing.fit.weighed_by(fit.noise)
    textbook = [t.as_law(1.0) for t in templates(fit.trials) if t.name == fit.shared.laws[0].name]
    return [replace(start, shared=replace(start.shared, laws=(law,))) for law in textbook]


def own_options(account: Account) -> list[Option]:
    """Return the events and the oscillation that might be added.

    They are told from a law by coming in each trial anew: one or two trials can't show that.
    """
    if len(account.fit.trials) < FEWEST_HELD_OUT:
        return []
    options = [
        Option(scan.event.name, scan.evidence, ENOUGH_OWN, _event_refit(account, scan))
        for scan in scan_events(account.fit)
        if scan.event.name not in account.steps
    ]
    scan = scan_oscillations(account.fit)
    name = scan.name or NAMELESS
    if name not in account.steps:
        options.append(Option(name, scan.evidence, ENOUGH_OWN, _oscillation_refit(account, scan, name)))
    return options


def _event_refit(account: Account, scan: EventScan) -> Callable[[], Account]:
    def refit() -> Account:
        exact = account.exact
        # a time was chosen in every trial that has a step
        price = float(np.log(TIMES_LOOKED_AT)) * int((scan.probability > 0.5).sum())
        added = replace(
            exact,
            fit=with_events(exact.fit, scan),
            steps=(*account.steps, scan.event.name),
            cost=account.cost + price,
        )
        return added.with_laws(account.fit.shared.laws)

    return refit


def _oscillation_refit(account: Account, scan: OscillationScan, name: str) -> Callable[[], Account]:
    def refit() -> Account:
        exact = account.exact
        added = replace(
            exact,
            fit=with_oscillation(exact.fit, scan, name),
            steps=(*account.steps, name),
            cost=account.cost + float(np.log(max(len(scan.grid_hz), 1))),
        )
        return added.with_laws(account.fit.shared.laws)

    return refit
