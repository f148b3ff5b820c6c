"""What is refitted at a step: the few that say most, and what they do not say."""

from __future__ import annotations

from typing import cast

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.name.options import Option
from analysis.mismatch.name.tries import promising


def _option(name: str, nats: float, beside: float) -> Option:
    def refit(_: Account) -> Account:
        raise AssertionError("nothing is refitted to choose what to refit")

    return Option(name, nats, 8.0, cast(Account, None), refit, beside)


def test_laws_that_are_one_to_a_line_leave_room_for_another() -> None:
    alike = [_option(f"arm {k}", 100.0 - k, 0.5) for k in range(4)]
    other, less = _option("dashpot", 60.0, 70.0), _option("inertia", 50.0, 20.0)
    assert promising([*alike, less, other], 0.0, few=False) == [*alike[:3], other]
    # what remains beside the best has to be enough by itself
    assert promising([*alike, _option("friction", 60.0, 2.0)], 0.0, few=False) == alike[:3]
