"""Which effects are worth a refit at a step of the search, by what they would gain to a line."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.itself import beside_textbook
from analysis.mismatch.evidence.left_over import LeftOver
from analysis.mismatch.fit.settled import settled_columns
from analysis.mismatch.levels import CLOSE, FEWEST_HELD_OUT, REFITTED, SURE
from analysis.mismatch.model.dictionary import templates
from analysis.mismatch.name.options import Option, law_options, own_options
from analysis.simulation.mechanism import library


@dataclass(frozen=True)
class Tries:
    """What is worth a refit, by name, the most promising first, and the most that each would gain to a line, nats.

    Of what is ``taken_up`` by the noise, or by the tissue, a line says little.
    """

    options: dict[str, list[Option]]
    largest: dict[str, float]
    taken_up: frozenset[str] = frozenset()


def worth_trying(account: Account, nothing: Account, left: LeftOver, among: Collection[str] | None) -> Tries:
    """Return the effects worth a refit beside the noise and without its slow part: law by law, and what comes anew.

    What was taken for slow noise is found where none is granted, most of all what comes in each trial anew. There slow
    noise that is none but noise looks like it, too: beside the noise, as large as it was measured, half of what is
    enough must be left of it. Laws that are granted to be off may be so for want of one, and so may be what they are
    like: what shows beside exact ones in a textbook's form, and not beside these, is tried, too. Of few trials all is
    tried: in their one tissue much is far from a line.

    ``left`` are the nats that the present laws leave to laws and to others; ``among`` names what is asked for, where
    that is not all.
    """
    wanted = [t for t in templates(account.fit.trials, account.names) if among is None or t.name in among]
    quick = account.quick()
    settled = settled_columns(quick.fit, wanted)
    listed = [law_options(account, nothing, wanted, settled)]
    if quick is not account:
        listed.append(law_options(quick, nothing, wanted, settled))
    few = len(account.fit.trials) < FEWEST_HELD_OUT
    least = CLOSE * SURE * left.to_laws.sum()
    worth = [promising(some, least, few) for some in listed]
    lead: list[Option] = []
    textbook = account if few else beside_textbook(account)
    if textbook is not account:
        # what is missing may be what the laws are granted to be off for, or have gone from their textbook for
        settled = settled_columns(textbook.fit, wanted)
        listed.append(law_options(textbook, nothing, wanted, settled, beside_exact=True))
        tried = {o.name for some in worth for o in some}
        lead = [o for o in promising(listed[-1], least, few) if o.name not in tried]
        worth.append(lead)
    # columns of all trials fill memory
    del settled
    # a line drawn beside noise that took the mismatch up says little of how much there is
    taken_up = frozenset(o.name for o in worth[0]) if quick is not account else frozenset()
    by_tissue = [o for o in listed[0] if _is_taken_up(o.name, account)]
    taken_up |= {o.name for o in (*by_tissue, *lead)}
    signs = {o.name: o.nats for o in (*listed[0], *lead)}
    anew = own_among(quick, among)
    beside = anew if quick is account else own_among(account, among)
    likely, likely_beside = (
        promising(some, CLOSE * SURE * left.to_others.sum(), few) for some in (anew, beside)
    )
    says_most = {o.name for o in (*likely, *likely_beside)}
    found = {o.name: o for o in (*beside, *anew)}
    listed.append(list(found.values()))
    worth.append([o for o in found.values() if o.name in says_most])
    signs |= {o.name: o.nats for o in beside}
    for looks_like in worth[-1]:
        # of rhythms only the band that says most is listed
        if looks_like.name not in signs:
            signs |= {o.name: o.nats for o in own_options(account, looks_like.name)}
    # found beside the noise it may be elsewhere, or be less bent by what else is slow
    elsewhere = [o for o in likely_beside if o is not found[o.name]]
    for some, every in zip(worth[1:], listed[1:], strict=True):
        # where one shows beside the noise something is there of its kind, and may be another that says more
        shown = [o.nats for o in every if signs.get(o.name, 0.0) > 0.5 * o.enough]
        signs |= {o.name: o.nats for o in some if shown and o.nats > min(shown)}
    options: dict[str, list[Option]] = {}
    for option in (option for some in (*worth, elsewhere) for option in some):
        if few or signs.get(option.name, 0.0) > 0.5 * option.enough:
            options.setdefault(option.name, []).append(option)
    options |= {option.name: [option] for option in by_tissue if option.name not in options}
    largest = {name: max(o.nats for some in listed for o in some if o.name == name) for name in options}
    in_order = sorted(options, key=lambda name: -largest[name])
    return Tries({name: options[name] for name in in_order}, largest, taken_up)


def _is_taken_up(name: str, account: Account) -> bool:
    """Whether the tissue stands for a law: a line about it then has nothing of that."""
    return name in library() and library()[name].like_a_quick_arm and account.fit.population.arm_ended


def own_among(account: Account, among: Collection[str] | None) -> list[Option]:
    """Return what might come in each trial anew, or of it what is asked for."""
    names = [""] if among is None else [name for name in among if library()[name].form != "law"]
    return [option for name in names for option in own_options(account, name)]


def promising(options: list[Option], least: float, few: bool) -> list[Option]:
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
