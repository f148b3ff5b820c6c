"""Effects that were considered at each step of the search, and which of them leads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.fit.arms import weakest_apart
from analysis.mismatch.fit.law_fit import at_bound
from analysis.mismatch.levels import ENOUGH_SHARED, INEXACT, KEPT, SMALL_SHARE, TWO_ERRORS
from analysis.simulation.mechanism import library


@dataclass(frozen=True)
class Rival:
    """An effect that was refitted at one step: evidence in nats over the account before, and its paired error.

    ``left`` are the nats that the effects before it leave over by being inexact, ``off`` what part of all that its
    account explains comes of granting that effects are off, ``itself`` whether it is more than what these may be.
    ``settled`` is whether its account was settled, if roughly.
    """

    name: str
    gain: float
    error: float
    account: Account
    left: float = 0.0
    off: float = 0.0
    itself: bool = True
    settled: bool = False

    @property
    def is_another(self) -> bool:
        """Whether it is not what a textbook says: none has it, its law ended elsewhere, or it is off by too much."""
        if self.name not in library() or self.off > SMALL_SHARE:
            return True
        return any(at_bound(law) for law in self.account.fit.shared.laws if law.name == self.name)

    def settled_account(self) -> Account:
        """Return its account settled; from where it stands, if it was settled roughly."""
        if self.settled:
            return self.account.exact.with_rhythms_settled().granting()
        return self.account.settled()

    def as_good_as(self, other: Rival) -> bool:
        """Whether another leads by no more than paired errors, or than laws are right to."""
        lead, error = other.account.gain_over(self.account)
        return lead <= max(TWO_ERRORS * error, INEXACT * other.gain)


@dataclass(frozen=True)
class Named:
    """The account that predicts best, who was considered for each of its effects, by name, and what each adds.

    ``adds`` are the nats that are lost without an effect, where the search came to know them, ``errors`` those of laws'
    parameters that are larger than curvature says.
    """

    account: Account
    rivals: dict[str, tuple[Rival, ...]]
    adds: dict[str, float]
    errors: Mapping[str, Mapping[str, float]] = field(default_factory=dict)


def as_they_stand(found: Sequence[Rival], account: Account) -> list[Rival]:
    """Return rivals with those that are near the best settled, where the account they were added to has rhythms.

    A rhythm is as large and steady as it was without them, and takes up more of one than of another.
    """
    least = KEPT * max((r.gain for r in found), default=0.0)
    several = sum(r.gain >= least for r in found) > 1
    if not several or not any(s.rhythms for s in account.fit.states):
        return list(found)
    return [_as_it_stands(r, account) if r.gain >= least else r for r in found]


def _as_it_stands(rival: Rival, account: Account) -> Rival:
    """Return a rival settled to a tenth of what rivals are told apart by, if it then predicts better."""
    there = rival.account.settled(max(ENOUGH_SHARED, INEXACT**2 * rival.gain))
    there = max(rival.account, there.let_go(), key=lambda a: a.nats)
    gain, error = there.gain_over(account)
    return replace(rival, account=there, gain=gain, error=error, settled=True)


def instead(step: tuple[Rival, ...], after: tuple[Rival, ...]) -> tuple[Rival, ...]:
    """Return the rivals of a step that explain what its best explains, by what was considered ``after`` it was added.

    What explains as much beside the best as without it was in its place by chance: it stands for another effect.
    """
    beside = {r.name: r.gain for r in after}
    return tuple(r for r in step if r is step[0] or beside.get(r.name, 0.0) < KEPT * r.gain)


def best_first(found: Sequence[Rival]) -> tuple[Rival, ...]:
    """Return rivals by what they gain; what is none that the library has makes way for one that explains as much.

    Where all are none, what one gains by being granted to be off it does not explain.
    """
    listed = sorted(found, key=lambda r: -r.gain)
    if all(r.is_another for r in listed):
        listed.sort(key=lambda r: -r.account.of_exact_laws)
    first = next((r for r in listed if not r.is_another and r.as_good_as(listed[0])), None)
    return tuple(sorted(listed, key=lambda r: r is not first))


def told_apart(account: Account, rivals: Mapping[str, tuple[Rival, ...]]) -> Account:
    """Return the account with the weakest arm as the law's, if that predicts as well.

    Trials that share their tissue show a set of arms, and any of them may have been fitted as the one that was missing.
    """
    for law in account.exact.fit.shared.laws:
        exchanged = weakest_apart(account.exact.fit, law)
        if exchanged is not None:
            other = replace(account.exact, fit=exchanged).with_laws(exchanged.shared.laws).reweighed()
            here, there = (replace(rivals[law.name][0], account=a) for a in (account, other))
            return other if there.as_good_as(here) else account
    return account
