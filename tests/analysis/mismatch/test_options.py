"""What is refitted at a step: the few that say most, and what they do not say."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import pytest

from analysis.mismatch.evidence.account import Account
from analysis.mismatch.evidence.left_over import left_over
from analysis.mismatch.fit.baseline import fit_baseline
from analysis.mismatch.levels import CLOSE
from analysis.mismatch.model.population import Population
from analysis.mismatch.name.options import Option
from analysis.mismatch.name.tries import promising, worth_trying
from analysis.mismatch.study.intake import take_in_memory
from analysis.recordings.trial import Trial
from sim_hardware.concealment.offline import study_plans

DASHPOT = '[[effects]]\nname = "parallel_dashpot"\ncoefficient_mn_s_per_mm = 0.6\n'


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


def test_a_dashpot_that_an_arm_of_the_tissue_stands_for_is_tried(
    record: Callable[..., list[Trial]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its arms' shortest then is as short as any, and the other stands for both of them: a third arm says most."""
    plans = study_plans(depths_mm=(0.3, 0.7), repeats=4, hold_s=5.0, dwell_s=0.4)
    nothing = Account(fit_baseline(take_in_memory(record(95, DASHPOT, plans)).trials))
    assert nothing.fit.population.arm_ended
    left = left_over(nothing, 0.0, {})
    tries = worth_trying(nothing, nothing, left, None)
    assert tries.largest["parallel_dashpot"] < CLOSE * max(tries.largest.values())
    assert "parallel_dashpot" in tries.options
    assert "parallel_dashpot" in tries.taken_up
    monkeypatch.setattr(Population, "arm_ended", False)
    assert "parallel_dashpot" not in worth_trying(nothing, nothing, left, None).options
